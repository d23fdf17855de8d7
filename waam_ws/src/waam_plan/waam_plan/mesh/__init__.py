"""The part: meshes and clouds read, checked and repaired."""
