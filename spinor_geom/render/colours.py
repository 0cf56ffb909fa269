"""The colours that meshes, patches, rims and values have in every picture."""

MESH_COLOUR, INSIDE_COLOUR, PATCH_COLOUR, RIM_COLOUR = "#c9ced6", "#8d7f73", "#f28e2b", "#1f3b73"
# of a surface by itself: its two sides, and the image of Ω's grid
FRONT_COLOUR, BACK_COLOUR, GRID_COLOUR = "#f6bd68", "#86b3dd", "#5a4a3c"
PLAIN_COLOUR, UNKNOWN_COLOUR = "#8fb3d9", "#bebebe"
# from low to high, perceptually uniform
VIRIDIS = (
    *("#440154", "#482475", "#414487", "#355f8d", "#2a788e", "#21918c"),
    *("#22a884", "#44bf70", "#7ad151", "#bddf26", "#fde725"),
)
