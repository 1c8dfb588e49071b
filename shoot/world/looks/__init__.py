"""What things look like: meshes, paint and light."""
