"""Pictures of meshes and fills."""
