"""The numbers of one result: meshes, bodies and normal maps against the truth."""
