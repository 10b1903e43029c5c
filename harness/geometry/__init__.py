"""What several rooms ask of a mesh and a camera: rays, normals, masks, pictures."""
