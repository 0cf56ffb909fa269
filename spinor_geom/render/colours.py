"""The colours that meshes, patches and rims have in every picture."""

MESH_COLOUR, INSIDE_COLOUR, PATCH_COLOUR, RIM_COLOUR = "#c9ced6", "#8d7f73", "#f28e2b", "#1f3b73"
