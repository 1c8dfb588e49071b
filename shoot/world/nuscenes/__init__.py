"""What the sensors see, as nuScenes has it: tables, maps, files."""
