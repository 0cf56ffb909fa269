"""The colours that meshes, patches and rims have in every picture."""

MESH_COLOUR, INSIDE_COLOUR, PATCH_COLOUR, RIM_COLOUR = "#c9ced6", "#8d7f73", "#f28e2b", "#1f3b73"
# of a surface by itself: its two sides, and the image of Ω's grid
FRONT_COLOUR, BACK_COLOUR, GRID_COLOUR = "#f6bd68", "#86b3dd", "#5a4a3c"
