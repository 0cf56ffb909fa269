"""Materials and textures are carried along, and names in strangers' files lead nowhere else."""

import importlib.util
import io
import os
import re
import shutil
import struct
import warnings
import zlib

import numpy as np
import pytest
import trimesh

from spinor_geom import fill_hole, read_mesh
from spinor_geom.adapters import MeshFile, textures, to_mesh
from spinor_geom.cli.main import main
from spinor_geom.errors import HiddenTextureWarning, MeshFileError
from spinor_geom.mesh.find_loops import find_boundary_loops
from spinor_geom.render.fill_scene import skin_of

CUBE = (
    "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
    "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt .2 .2\nvt .8 .2\nvt .8 .8\nvt .2 .8\nusemtl skin\n"
    "f 4/4 3/3 2/2 1/1\nf 1/1 2/2 6/6 5/5\nf 2/2 3/3 7/7 6/6\nf 3/3 4/4 8/8 7/7\nf 4/4 1/1 5/5 8/8\n"
)

ICOSAHEDRON = trimesh.creation.icosphere(subdivisions=1)
ICO = ICOSAHEDRON.faces.tolist()


def png(width=1, height=1):
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows = zlib.compress(b"\0\xff\0\0")
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def textured(folder, *, library="skin.mtl", image="maps/skin.png"):
    """An open cube with a material library and an image in a folder below."""
    (folder / "maps").mkdir(parents=True)
    (folder / "maps" / "skin.png").write_bytes(png())
    (folder / "skin.mtl").write_text(f"newmtl skin\nKd 1 1 1\nmap_Kd {image}\n")
    (folder / "cube.obj").write_text(f"mtllib {library}\n{CUBE}")
    return folder / "cube.obj"


def test_files_are_copied_beside_the_output(tmp_path, capsys):
    source, out = textured(tmp_path / "in"), tmp_path / "out"
    assert main(["fill", str(source), "-o", str(out / "filled.obj")]) == 0
    assert (out / "skin.mtl").read_bytes() == (source.parent / "skin.mtl").read_bytes()
    assert (out / "maps" / "skin.png").read_bytes() == png()
    capsys.readouterr()
    (out / "skin.mtl").write_text("of another mesh")
    assert main(["fill", str(source), "-o", str(out / "filled.obj")]) == 0
    assert "skin.mtl was not copied: another file" in capsys.readouterr().err
    assert (out / "skin.mtl").read_text() == "of another mesh"


@pytest.mark.parametrize("path", [(".glb", ".obj"), (".ply", ".glb"), (".glb", ".ply", ".obj")])
def test_texture_seams_go_through_formats(path, tmp_path):
    rng = np.random.default_rng(3)
    corners = [[(v, uv) for v, uv in zip(face, rng.random((3, 2)).round(4), strict=True)] for face in ICO[:-1]]
    source = textured(tmp_path / "in", library='"skin.mtl"', image='"maps/the skin.png"')
    (source.parent / "maps" / "skin.png").rename(source.parent / "maps" / "the skin.png")
    lines = [f"vt {uv[0]} {uv[1]}\n" for face in corners for _, uv in face]
    lines += [
        f"f {' '.join(f'{v + 1}/{3 * k + i + 1}' for i, (v, _) in enumerate(f))}\n" for k, f in enumerate(corners)
    ]
    head = 'mtllib "skin.mtl"\n' + "".join(f"v {x} {y} {z}\n" for x, y, z in ICOSAHEDRON.vertices.round(4))
    source.write_text(head + "".join(lines))
    mesh = fill_hole(read_mesh(source).as_stored(path[0]))
    assert isinstance(mesh, MeshFile)
    old, wanted = len(corners), [(*mesh.mesh.vertices[v], *uv) for face in corners for v, uv in face]
    for number, suffix in enumerate(path):
        (tmp_path / str(number)).mkdir()
        notes = mesh.write(tmp_path / str(number) / f"mesh{suffix}")
        assert [note for note in notes if "each new face has the colour of the nearest" not in note] == []
        assert len(notes) == (number == 0)
        mesh = read_mesh(tmp_path / str(number) / f"mesh{suffix}")
        assert find_boundary_loops(mesh.mesh) == []
        contents = mesh.contents.split()
        got = np.hstack([contents.vertices, contents.attributes["uv"]])[contents.polygons.corners]
        np.testing.assert_allclose(got[: 3 * old], wanted, atol=1e-6)
        new = got[3 * old :, 3:].reshape(-1, 3, 2)
        assert len(new)
        assert np.ptp(new, axis=1).max() < 1e-6
        image = mesh.path.with_suffix(".png") if suffix != ".glb" else None
        assert image is None or image.read_bytes() == png()


def test_what_is_lost_is_told(tmp_path):
    mesh = read_mesh(textured(tmp_path / "in"))
    for suffix in (".stl", ".off"):
        assert any("textures are left out" in note for note in mesh.write(tmp_path / f"mesh{suffix}"))
    seam = tmp_path / "in" / "seam.obj"
    seam.write_text(f"mtllib skin.mtl\n{CUBE}vn 0 0 1\nf 5/1/1 6/2/1 7/3/1\n")
    notes = " ".join(read_mesh(seam).write(tmp_path / "seam.glb"))
    assert "normals are left out: some vertices have several" in notes
    assert any("new faces have no normals" in note for note in fill_hole(seam).write(tmp_path / "s.obj"))
    seam.write_text(f"mtllib skin.mtl\n{CUBE}f 5 6 7\n")
    assert any("new faces have no texture coordinates" in note for note in fill_hole(seam).write(tmp_path / "s.obj"))


@pytest.mark.parametrize(
    ("library", "lost"),
    [
        ("newmtl skin\nmap_Kd maps/skin.png\n", None),
        ("newmtl skin\nmap_Kd -s 2 2 1 maps/skin.png\n", "not -s 2 2 1"),
        ("newmtl skin\nmap_Kd maps/skin.png\nmap_Bump -bm 0.5 maps/bumps.png\n", "not map_Bump"),
        ("newmtl skin\nmap_Kd maps/skin.png\nnewmtl red paint\nKd 1 0 0\n", "not the colour of red paint"),
        (
            "newmtl skin\nmap_Kd maps/skin.png\n" + "".join(f"newmtl m{k}\n" for k in range(7)),
            "m0, the colour of m1, the colour of m2, the colour of m3, the colour of m4, and 2 more",
        ),
    ],
)
def test_what_materials_have_besides_an_image_is_told(library, lost, tmp_path):
    source = textured(tmp_path / "in")
    source.write_text(source.read_text().replace("usemtl skin\n", ""))
    (source.parent / "skin.mtl").write_text(library)
    for suffix in (".glb", ".ply"):
        notes = read_mesh(source).write(tmp_path / f"mesh{suffix}")
        assert [(lost or "") in note for note in notes] == [True] * (lost is not None), notes
        assert lost is None or lost in notes[0]
        assert read_mesh(tmp_path / f"mesh{suffix}").textured(8) is not None
    assert read_mesh(source).write(tmp_path / "same.obj")[1:] == ()


def test_materials_that_the_mesh_does_not_use_do_not_count(tmp_path):
    source = textured(tmp_path / "in")
    (source.parent / "other.png").write_bytes(png(2, 2))
    text = (source.parent / "skin.mtl").read_text()
    (source.parent / "skin.mtl").write_text(f"{text}newmtl other\nmap_Kd -s 2 2 other.png\nmap_d x.png\nnewmtl plain\n")
    assert read_mesh(source).write(tmp_path / "mesh.glb") == ()
    assert read_mesh(tmp_path / "mesh.glb").textured(8) is not None
    read_mesh(source).write(tmp_path / "mesh.obj")
    assert (tmp_path / "other.png").is_file()


@pytest.mark.parametrize("quote", ["", '"'])
def test_names_with_spaces_follow_options(quote, tmp_path):
    source = textured(tmp_path / "in", image=f"-s 1 1.5e0 1 -clamp on -mm 0 1 {quote}maps/my skin.png{quote}")
    (source.parent / "maps" / "skin.png").rename(source.parent / "maps" / "my skin.png")
    assert read_mesh(source).textured(8) is not None


def test_new_faces_have_the_material_of_the_nearest_old_ones(tmp_path):
    t = 2 * np.pi * np.arange(12) / 12
    rings = [f"v {np.cos(a):.4f} {np.sin(a):.4f} {z}\n" for z in range(3) for a in t]
    uses = ["usemtl 50% below\n", "usemtl above\n"]
    around = [(0, 0, 1), (0, 1, 2), (1, 1, 3), (1, 0, 4)]
    faces = [
        "f " + " ".join(f"{12 * (row + up) + (i + right) % 12 + 1}/{uv}" for up, right, uv in around)
        for row in range(2)
        for i in range(12)
    ]
    text = "".join(rings) + "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    text += uses[0] + "\n".join(faces[:12]) + "\n" + uses[1] + "\n".join(faces[12:]) + "\n"
    (tmp_path / "tube.obj").write_text(text)
    fill_hole(tmp_path / "tube.obj").write(tmp_path / "filled.obj")
    added = (tmp_path / "filled.obj").read_text().removeprefix(text)
    patches = re.findall(r"g spinor_geom_fill_(\d)\n(usemtl [^\n]*)?\n?(.*?)(?=g |\Z)", added, re.DOTALL)
    heights = {}
    for number, use, lines in patches:
        points = read_mesh(tmp_path / "filled.obj").contents.vertices
        corners = [int(word) - 1 for word in re.findall(r" (\d+)/", lines)]
        heights[number] = points[corners, 2].mean(), use or "usemtl above"
    assert {use + "\n" for _, use in heights.values()} == set(uses)
    assert all((height < 1) == (use == "usemtl 50% below") for height, use in heights.values())


@pytest.mark.parametrize("suffix", [".obj", ".glb", ".ply"])
@pytest.mark.parametrize("order", ["ascii", "binary_little_endian"])
def test_texture_coordinates_of_faces_in_ply_files(suffix, order, tmp_path):
    (tmp_path / "skin.png").write_bytes(png())
    faces = ICO[:-1]
    uv = np.random.default_rng(4).integers(0, 64, (len(faces), 3, 2)) / 64
    header = f"ply\nformat {order} 1.0\ncomment TextureFile skin.png\nelement vertex {len(ICOSAHEDRON.vertices)}\n"
    header += "".join(f"property double {name}\n" for name in "xyz")
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\n"
    header += "property list uchar float texcoord\nproperty int texnumber\nend_header\n"
    if order == "ascii":
        body = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in ICOSAHEDRON.vertices.tolist()).encode()
        for face, own in zip(faces, uv.reshape(-1, 6).tolist(), strict=True):
            body += f"3 {' '.join(map(str, face))} 6 {' '.join(map(str, own))} 0\n".encode()
    else:
        body = np.asarray(ICOSAHEDRON.vertices, dtype="<f8").tobytes()
        for face, own in zip(faces, uv.reshape(-1, 6).tolist(), strict=True):
            body += struct.pack("<B3iB6fi", 3, *face, 6, *own, 0)
    (tmp_path / "mesh.ply").write_bytes(header.encode() + body)
    filled = fill_hole(read_mesh(tmp_path / "mesh.ply").as_stored(suffix))
    assert isinstance(filled, MeshFile)
    (tmp_path / "out").mkdir()
    (note,) = filled.write(tmp_path / "out" / f"filled{suffix}")
    assert "each new face has the colour of the nearest" in note
    contents = read_mesh(tmp_path / "out" / f"filled{suffix}").contents.split()
    got = contents.attributes["uv"][contents.polygons.corners].reshape(-1, 3, 2)
    np.testing.assert_allclose(got[: len(faces)], uv, atol=1e-6)
    assert len(got) > len(faces)
    assert np.ptp(got[len(faces) :], axis=1).max() == 0
    assert read_mesh(tmp_path / "out" / f"filled{suffix}").textured(8) is not None


def as_link(folder):
    (folder / "skin.mtl").rename(folder.parent / "real.mtl")
    (folder / "skin.mtl").symlink_to(folder.parent / "real.mtl")


def in_linked_folder(folder):
    (folder / "maps").rename(folder.parent / "elsewhere")
    (folder / "maps").symlink_to(folder.parent / "elsewhere")


def as_pipe(folder):
    (folder / "maps" / "skin.png").unlink()
    os.mkfifo(folder / "maps" / "skin.png")


def as_long_file(folder):
    with (folder / "maps" / "skin.png").open("r+b") as file:
        file.truncate(textures.MOST_BYTES + 1)


@pytest.mark.parametrize(
    ("library", "image", "spoil", "reason"),
    [
        ("../secret.mtl", "maps/skin.png", None, "leads outside"),
        ("/etc/passwd", "maps/skin.png", None, "leads outside"),
        ("C:/secret.mtl", "maps/skin.png", None, "leads outside"),
        ("..\\secret.mtl", "maps/skin.png", None, "leads outside"),
        (".hidden.mtl", "maps/skin.png", None, "hidden"),
        ("conftest.py", "maps/skin.png", None, "not that of a material library"),
        ("skin.mtl", "/dev/zero", None, "leads outside"),
        ("skin.mtl", "../secret.png", None, "leads outside"),
        ("skin.mtl", "-s 1 1 1 ../secret.png", None, "leads outside"),
        ("skin.mtl", "maps/run.sh", None, "not that of a material library"),
        ("skin.mtl", "maps/missing.png", None, "cannot be read"),
        ("skin.mtl", "maps/skin.png", as_link, "a link"),
        ("skin.mtl", "maps/skin.png", in_linked_folder, "a link"),
        ("skin.mtl", "maps/skin.png", as_pipe, "not a regular file"),
        ("skin.mtl", "maps/skin.png", as_long_file, "MiB"),
    ],
)
def test_names_in_a_file_lead_nowhere_else(library, image, spoil, reason, tmp_path):
    source, out = textured(tmp_path / "in", library=library, image=image), tmp_path / "out"
    out.mkdir()
    for name in ("secret.mtl", "secret.png"):
        (tmp_path / name).write_bytes(png())
    (source.parent / "conftest.py").write_text("")
    (source.parent / ".hidden.mtl").write_text("")
    if spoil is not None:
        spoil(source.parent)
    before = {path for path in tmp_path.rglob("*") if out not in path.parents}
    notes = read_mesh(source).write(out / "copy.obj")
    assert any(reason in note and "was not copied" in note for note in notes), notes
    assert {path for path in tmp_path.rglob("*") if out not in path.parents} == before
    assert {path.suffix for path in out.rglob("*") if path.is_file()} <= {".obj", ".mtl"}


def test_names_are_followed_up_to_a_number_and_a_size(tmp_path, monkeypatch):
    source, out = textured(tmp_path / "in"), tmp_path / "out"
    out.mkdir()
    names = [f"maps/{k}.png" for k in range(8)]
    for name in names:
        (tmp_path / "in" / name).write_bytes(png())
    size = len(png())

    def written(*, missing, bytes_of_images):
        lines = [f"map_Ks maps/missing{k}.png" for k in range(missing)] + [f"map_Kd {name}" for name in names]
        library = "\n".join(lines)
        (tmp_path / "in" / "skin.mtl").write_text(library)
        monkeypatch.setattr(textures, "MOST_BYTES", len(library) + bytes_of_images)
        shutil.rmtree(out / "maps", ignore_errors=True)
        (out / "skin.mtl").unlink(missing_ok=True)
        return read_mesh(source).write(out / "copy.obj"), len(list(out.glob("maps/*.png")))

    assert written(missing=0, bytes_of_images=8 * size) == ((), 8)
    notes, copied = written(missing=0, bytes_of_images=5 * size)
    assert copied == 5
    assert len(notes) == 3
    assert all("MiB" in note for note in notes)
    notes, copied = written(missing=5 * textures.MOST_FILES, bytes_of_images=8 * size)
    assert copied == 0
    assert len(notes) == textures.MOST_FILES
    assert f"more than {textures.MOST_FILES} files" in notes[-1]


def test_a_library_of_many_materials_does_not_take_a_search_for_each(tmp_path):
    (tmp_path / "a.mtl").write_text("".join(f"newmtl {k}\nmap_Kd a.png\n" for k in range(40_000)))
    appearance = textures.Appearance(names=("a.mtl",), materials=tuple(map(str, range(40_000, 80_000))))
    assert textures.Companions.of(tmp_path, appearance).texture is None  # took minutes


def test_nothing_is_written_through_a_link_beside_the_output(tmp_path):
    source, out, other = textured(tmp_path / "in"), tmp_path / "out", tmp_path / "other"
    out.mkdir()
    other.mkdir()
    (out / "maps").symlink_to(other)
    assert any("a link beside the output" in note for note in read_mesh(source).write(out / "copy.obj"))
    assert list(other.iterdir()) == []


def test_no_image_and_images_that_would_fill_the_memory_are_not_shown():
    image = pytest.importorskip("PIL.Image")
    with io.BytesIO() as file:
        image.new("1", (10_000, 9_500)).save(file, "png")
        huge = file.getvalue()
    assert len(huge) < 100_000
    for data in (b"no image", huge):
        with pytest.raises(MeshFileError, match=r"'a.png' is damaged, too large"):
            textures.Texture(data=data, name="a.png").pixels(2)
    assert textures.Texture(data=png(), name="a.png").pixels(2).shape == (1, 1, 3)


@pytest.mark.parametrize(
    ("image", "library", "told"),
    [
        (b"no image", "map_Kd skin.png", "'skin.png' is damaged"),
        (None, "map_Kd skin.png", "'skin.png', which the file refers to, was not copied: it cannot be read"),
        (png(), "map_Kd skin.png\nnewmtl other\nmap_Kd skin.jpg", "only a single texture|skin.jpg"),
    ],
)
def test_a_texture_that_is_not_shown_is_told(image, library, told, tmp_path, capsys):
    both = CUBE.replace("f 3/3", "usemtl other\nf 3/3")
    (tmp_path / "cube.obj").write_text(f"mtllib skin.mtl\n{both}")
    (tmp_path / "skin.mtl").write_text(f"newmtl skin\n{library}\n")
    if image is not None:
        (tmp_path / "skin.png").write_bytes(image)
    file = read_mesh(tmp_path / "cube.obj")
    with pytest.warns(HiddenTextureWarning, match=told):
        assert skin_of(file, file.mesh) == {}
    with warnings.catch_warnings():
        warnings.resetwarnings()  # the command shows warnings. They are errors in tests
        assert main(["loops", str(tmp_path / "cube.obj"), "--html", str(tmp_path / "loops.html")]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("spinor-geom: the texture is not shown: ")


def colours_of(skin):
    """The colours at the corners of the first two triangles, of the nearest pixel."""
    height, width, _ = skin["image"].shape
    x, y = skin["skin"][:6].T
    return skin["image"][np.rint((1 - y) * (height - 1)).astype(int), np.rint(x * (width - 1)).astype(int)]


def test_textures_of_objects_are_shown_as_those_of_files(tmp_path):
    image = pytest.importorskip("PIL.Image")
    pixels = np.random.default_rng(3).integers(0, 256, (9, 9, 3), dtype=np.uint8)
    (tmp_path / "skin.mtl").write_text("newmtl skin\nmap_Kd skin.png\n")
    image.fromarray(pixels).save(tmp_path / "skin.png")
    source = tmp_path / "cube.obj"
    triangles = re.sub(r"f (\S+) (\S+) (\S+) (\S+)", r"f \1 \2 \3\nf \1 \3 \4", CUBE)
    source.write_text(f"mtllib skin.mtl\n{triangles}")
    wanted = colours_of(skin_of(read_mesh(source), read_mesh(source).mesh))
    assert np.ptp(wanted, axis=0).min() > 0
    read = trimesh.load_mesh(source, process=False)
    objects = [read, trimesh.Scene(read), read_mesh(tmp_path / "cube.obj")]
    if importlib.util.find_spec("open3d") is not None:
        from open3d import io as open3d_io

        (tmp_path / "simple.obj").write_text(source.read_text().replace(" .", " 0."))  # Open3D reads no ".2"
        objects.append(open3d_io.read_triangle_mesh(str(tmp_path / "simple.obj")))
    for given in objects:
        np.testing.assert_array_equal(colours_of(skin_of(given, to_mesh(given))), wanted)
        filled, report = fill_hole(given, return_report=True)
        np.testing.assert_array_equal(colours_of(skin_of(filled, report.original)), wanted)
