"""A Blender extension: fills holes in Edit Mode with minimal surfaces and smooth continuations."""

import re
from collections import Counter
from dataclasses import replace

import bmesh
import bpy
import numpy as np

KINDS = {"minimal": "minimal", "discrete": "discrete minimal", "smooth": "smooth"}
# advice for Python and the command line, and what it is in Blender
ADVICE = {
    r"give its index in loop=": "select its rim",
    r"by its index in loop=": "with its rim selected",
    r"(fill_hole\(mesh, merge=|read_mesh\().*--merge(.* on the command line)?": "Merge by Distance",
    r"target_edge_length": "the Edge Length",
    r"time_limit": "the Time Limit",
    r" \(--[\w-]+\)|; islands='join' joins them": "",
}

# spinor_geom is imported on use: that takes longer than the start of Blender should


class Options:
    """The options that the sidebar keeps for the next fill, and an operator for its last one."""

    edge_length: bpy.props.FloatProperty(
        name="Edge Length",
        description="Of the new faces; 0 for that of each rim",
        min=0.0,
        subtype="DISTANCE",
        options={"SKIP_SAVE"},
    )
    time_limit: bpy.props.FloatProperty(
        name="Time Limit",
        description="Seconds for each hole; a fill that reaches it is coarser or less exact",
        default=20.0,
        min=0.1,
        options={"SKIP_SAVE"},
    )


class Settings(Options, bpy.types.PropertyGroup):
    """The options of the sidebar."""


class Fill(Options):
    """What the operators share."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012

    @classmethod
    def poll(cls, context):
        """Whether a mesh is being edited."""
        return context.mode == "EDIT_MESH"

    def invoke(self, context, event):
        """Runs with the options of the sidebar, from a button, a menu or a key."""
        settings = context.scene.spinor_geom
        self.edge_length, self.time_limit = settings.edge_length, settings.time_limit
        return self.execute(context)

    def execute(self, context):
        """Fills the chosen holes of the meshes that are being edited, selects the new faces, and reports."""
        from spinor_geom.errors import SpinorGeomError

        objects = context.objects_in_mode_unique_data
        self.is_anything_selected = any(obj.data.total_vert_sel for obj in objects)
        outcomes, notes, extensions = [], [], {}
        context.window_manager.progress_begin(0, 1)
        try:
            for obj in objects:
                report, found, extension = self.filled(context, obj)
                outcomes += found
                notes += report.notes if found else ()
                if len(extension.faces):
                    extensions[obj] = extension
        except SpinorGeomError as error:
            self.report({"ERROR"}, f"{obj.name}: {in_blender(str(error))}")
            return {"CANCELLED"}
        finally:
            context.window_manager.progress_end()
        if extensions:
            bpy.ops.mesh.select_all(action="DESELECT")
        for obj, extension in extensions.items():
            add(obj, extension)
        self.tell(outcomes, notes, sum(len(extension.faces) for extension in extensions.values()))
        return {"FINISHED"} if extensions else {"CANCELLED"}

    def filled(self, context, obj):
        """The report, the outcomes of the chosen loops, and what is to be added to the mesh, in its coordinates."""
        import spinor_geom
        from spinor_geom.adapters import BlenderObjectAdapter

        adapter = BlenderObjectAdapter()
        mesh = adapter.to_mesh(obj)
        loops = spinor_geom.boundary_loops(mesh)
        chosen, hidden = chosen_loops(obj, loops)
        progress = context.window_manager.progress_update
        _, report = spinor_geom.fill_hole(
            mesh,
            chosen if self.is_anything_selected else "all",
            continuity=self.continuity,
            target_edge_length=self.edge_length or "auto",
            time_limit=self.time_limit,
            return_report=True,
            on_loop=lambda outcome, count: progress((outcome.index + 1) / len(loops)),
        )
        outcomes = [one for one in report.loops if (one.requested or one.is_border) and one.index not in hidden]
        shown = ~np.isin(report.extension.face_loops, hidden)
        faces, face_loops = report.extension.faces[shown], report.extension.face_loops[shown]
        extension = replace(report.extension, faces=faces, face_loops=face_loops)
        return report, outcomes, adapter.in_own_coordinates(obj, extension)

    def tell(self, outcomes, notes, faces):
        """Reports the counts, the notes, and each shortcoming with its reason."""
        if not outcomes:
            where = (
                "at the selection; deselect all to fill all holes"
                if self.is_anything_selected
                else "in the visible mesh"
            )
            self.report({"WARNING"}, f"There is no hole {where}")
            return
        kinds = Counter(KINDS[one.kind] for one in outcomes if one.filled)
        counts = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        filled = f"{kinds.total()} of {len(outcomes)} holes filled{counts and f' ({counts})'}, {faces} new faces"
        reasons = [in_blender(text) for text in (*notes, *(text for one in outcomes for text in one.shortcomings))]
        for reason in reasons:
            self.report({"WARNING"}, reason)
        self.report({"WARNING" if reasons else "INFO"}, "; ".join([filled, *reasons[:1]]))


def in_blender(text):
    """A sentence of an error or a report with advice for Blender."""
    for advice, own in ADVICE.items():
        text = re.sub(advice, own, text)
    return text


def chosen_loops(obj, loops):
    """The indices of the loops with a selected edge, or else with a selected vertex, and of those with hidden ones."""
    edited = bmesh.from_edit_mesh(obj.data)
    edited.verts.ensure_lookup_table()
    rims = [[edited.verts[index] for index in loop.vertex_ids.tolist()] for loop in loops]

    def where(is_it, rims):
        return [index for index, rim in enumerate(rims) if any(map(is_it, rim))]

    edges = [[edited.edges.get(ends) for ends in zip(rim, rim[1:] + rim[:1], strict=True)] for rim in rims]
    chosen = where(lambda edge: edge.select, edges) or where(lambda vertex: vertex.select, rims)
    return chosen, where(lambda vertex: vertex.hide, rims)


def add(obj, extension):
    """Adds new faces to the mesh that is being edited, and selects them."""
    from spinor_geom.adapters.blender_mesh import append

    edited = bmesh.from_edit_mesh(obj.data)
    for face in append(edited, extension, obj.active_shape_key_index):
        face.hide_set(False)
        face.select_set(True)
    bmesh.update_edit_mesh(obj.data)


class FillMinimal(Fill, bpy.types.Operator):
    """The operator of films."""

    bl_idname = "spinor_geom.fill_minimal"
    bl_label = "Fill Hole: Minimal Surface"
    bl_description = "Fill the selected holes, or all if nothing is selected, with minimal surfaces"
    continuity = "film"


class FillSmooth(Fill, bpy.types.Operator):
    """The operator of smooth continuations."""

    bl_idname = "spinor_geom.fill_smooth"
    bl_label = "Fill Hole: Smooth"
    bl_description = "Fill the selected holes, or all if nothing is selected, and continue the mesh smoothly"
    continuity = "smooth"


class FillAutomatic(Fill, bpy.types.Operator):
    """The operator that chooses between the two."""

    bl_idname = "spinor_geom.fill_automatic"
    bl_label = "Fill Hole: Automatic"
    bl_description = "Fill ends of pipes with minimal surfaces, other holes smoothly: the selected ones, or all"
    continuity = "auto"


OPERATORS = (FillMinimal, FillSmooth, FillAutomatic)


def draw_operators(self, context):
    """Draws the operators in the Face menu or in the panel."""
    self.layout.separator()
    for operator in OPERATORS:
        self.layout.operator(operator.bl_idname)


class Sidebar(bpy.types.Panel):
    """The panel of the sidebar."""

    bl_idname = "SPINOR_GEOM_PT_fill"
    bl_label = "Fill Hole"
    bl_category = "Fill Hole"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_context = "mesh_edit"

    def draw(self, context):
        """Draws the options and the operators."""
        self.layout.use_property_split = True
        self.layout.prop(context.scene.spinor_geom, "edge_length")
        self.layout.prop(context.scene.spinor_geom, "time_limit")
        draw_operators(self, context)


CLASSES = (Settings, *OPERATORS, Sidebar)


def register():
    """Adds the operators to Blender."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.Scene.spinor_geom = bpy.props.PointerProperty(type=Settings)
    bpy.types.VIEW3D_MT_edit_mesh_faces.append(draw_operators)


def unregister():
    """Removes them."""
    bpy.types.VIEW3D_MT_edit_mesh_faces.remove(draw_operators)
    del bpy.types.Scene.spinor_geom
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
