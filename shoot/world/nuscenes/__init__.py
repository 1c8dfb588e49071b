"""What they see as nuScenes has it: tables, maps, files."""
