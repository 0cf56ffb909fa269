"""The readers of .vtk and .vtp files: equal to VTK's own for sound files, errors for malformed ones."""

from __future__ import annotations

import base64
import struct
import zlib
from importlib import import_module
from itertools import product
from typing import Any

import numpy as np
import pytest
import pyvista

from spinor_geom.adapters import read_mesh
from spinor_geom.adapters.pyvista_mesh import set_array
from spinor_geom.adapters.vtk_legacy import read_legacy
from spinor_geom.adapters.vtk_xml import read_xml
from spinor_geom.errors import MeshFileError

VTK = import_module(pyvista.vtk_backend())


def with_all_data(mesh):
    """A mesh with arrays of all types, names and roles."""
    rng = np.random.default_rng(0)
    points, cells = mesh.n_points, mesh.n_cells
    for name in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64"):
        mesh.point_data[name] = rng.integers(0, 100, (points, 1 + len(name) % 3)).astype(name)
    mesh.point_data["a b%ü"] = rng.standard_normal(points)
    mesh.point_data["normal"] = rng.standard_normal((points, 3))
    mesh.point_data["large"] = rng.integers(-(2**62), 2**62, points)
    mesh.cell_data["part"] = np.arange(cells)
    set_array(mesh.cell_data, "text", np.array([f"é {'long' * (k == 3)} {k}" for k in range(cells)]))
    set_array(mesh.field_data, "words", np.array(["two words", ""]))
    mesh.field_data["time"] = [1.5, 2.5]
    mesh.point_data.active_scalars_name = "int16"
    mesh.active_texture_coordinates = rng.random((points, 2))
    mesh.point_data.active_normals_name = "normal"
    return mesh


@pytest.fixture(scope="module")
def polygons():
    ball = pyvista.Sphere(theta_resolution=6, phi_resolution=5)
    return with_all_data(pyvista.PolyData(ball.points, faces=ball.faces, lines=[3, 0, 1, 2, 2, 4, 5], verts=[1, 0]))


def assert_equal(mesh, wanted):
    assert type(mesh) is type(wanted)
    assert mesh.points.dtype == wanted.points.dtype
    assert np.array_equal(mesh.points, wanted.points)
    for cells in ("cells", "celltypes") if isinstance(mesh, pyvista.UnstructuredGrid) else ("verts", "lines", "faces"):
        assert np.array_equal(getattr(mesh, cells), getattr(wanted, cells))
    for data in ("point_data", "cell_data", "field_data"):
        own, other = getattr(mesh, data), getattr(wanted, data)
        assert own.keys() == other.keys()
        for name in own:
            assert own[name].dtype == other[name].dtype, name
            assert np.array_equal(own[name], other[name]), name
        if data != "field_data":
            for role in ("scalars", "normals", "texture_coordinates"):
                assert getattr(own, f"active_{role}_name") == getattr(other, f"active_{role}_name")


@pytest.mark.parametrize(("version", "is_binary", "is_grid"), [*product((42, 51), (False, True), (False, True))])
def test_legacy_files_are_read_as_by_vtk(tmp_path, polygons, version, is_binary, is_grid):
    writer: Any = VTK.vtkUnstructuredGridWriter() if is_grid else VTK.vtkPolyDataWriter()
    writer.SetInputData(polygons.cast_to_unstructured_grid() if is_grid else polygons)
    writer.SetFileVersion(version)
    writer.SetFileType(2 if is_binary else 1)
    writer.SetFileName(str(tmp_path / "mesh.vtk"))
    writer.Write()
    assert_equal(read_legacy((tmp_path / "mesh.vtk").read_bytes()).to_pyvista(), pyvista.read(tmp_path / "mesh.vtk"))


@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended", "Encoded"])
@pytest.mark.parametrize("compressor", ["None", "ZLib", "LZ4", "LZMA"])
def test_xml_files_are_read_as_by_vtk(tmp_path, polygons, mode, compressor):
    path = tmp_path / "mesh.vtp"
    for order, head, pieces in (("Big", 32, 1), ("Little", 64, 3)):
        writer: Any = VTK.vtkXMLPolyDataWriter()
        mesh = polygons.copy()
        if pieces > 1:  # of which VTK does not sort texts by kind of cell
            del mesh.cell_data["text"]
        writer.SetInputData(mesh)
        getattr(writer, f"SetDataModeTo{mode.replace('Encoded', 'Appended')}")()
        writer.SetEncodeAppendedData(mode == "Encoded")
        getattr(writer, f"SetCompressorTypeTo{compressor}")()
        getattr(writer, f"SetByteOrderTo{order}Endian")()
        getattr(writer, f"SetHeaderTypeToUInt{head}")()
        writer.SetBlockSize(1024)
        writer.SetNumberOfPieces(pieces)
        writer.SetFileName(str(path))
        writer.Write()
        assert_equal(read_xml(path.read_bytes()).to_pyvista(), pyvista.read(path))


POINTS = "POINTS 3 float\n0 0 0 1 0 0 0 1 0\n"
FACE = POINTS + "POLYGONS 1 4\n3 0 1 2\n"
TEXTS = FACE + "FIELD f 1\nt 1 100000 string\n" + "x" * 1000 + "\na" * 100_000 + "\n"
# the sections of legacy files, and words of the error
LEGACY = {
    "points beyond the file": ("POINTS 99999999999 float\n0 0 0\n", "POINTS: declares '99999999999' items"),
    "fewer points than declared": ("POINTS 9 float\n0 0 0\n", "POINTS: declares 27 values, but the file ends"),
    "no number": (POINTS.replace("1", "one"), "POINTS: could not convert"),
    "an integer out of range": (FACE.replace("3 0 1 2", f"3 0 1 {2**40}"), "POLYGONS: Python integer"),
    "a vertex beyond": (FACE.replace("3 0 1 2", "3 0 1 9"), "POLYGONS: cell 0 has point 9 of 3"),
    "a negative vertex": (FACE.replace("3 0 1 2", "3 0 -1 2"), "POLYGONS: cell 0 has point -1 of 3"),
    "a line beyond": (FACE + "LINES 1 3\n2 0 7\n", "LINES: cell 0 has point 7 of 3"),
    "a cell beyond its section": (FACE.replace("3 0 1 2", "100000 0 1 2"), "POLYGONS: its 4 numbers are not 1 cells"),
    "a negative count": (FACE.replace("3 0 1 2", "-3 0 1 2"), "POLYGONS: its 4 numbers are not 1 cells"),
    "more cells than numbers": (FACE.replace("POLYGONS 1", "POLYGONS 2"), "POLYGONS: its 4 numbers are not 2 cells"),
    "columns beyond the file": (
        FACE + "POINT_DATA 3\nSCALARS q float 400000000\nLOOKUP_TABLE default\n1 2 3\n",
        "SCALARS: declares '400000000' items",
    ),
    "rows that are no points": (FACE + "POINT_DATA 2\nSCALARS q float\nLOOKUP_TABLE d\n1 2\n", "has 2 rows for 3"),
    "texts beyond the file": (FACE + "FIELD f 1\nn 1 999999999 string\na\n", "FIELD: declares '999999999' items"),
    "texts of different lengths": (TEXTS, "FIELD: its texts have too different lengths"),
    "too many arrays": (
        FACE + "FIELD f 2000\n" + "".join(f"a{k} 1 1 int\n0\n" for k in range(2000)),
        "has 2000 arrays of data, more than 1000",
    ),
    "an unknown section": (FACE + "MESHES 1\n", "'MESHES' is not a section"),
    "an unknown type": (FACE.replace("float", "quad"), "POINTS: 'quad' is not a supported type"),
}


@pytest.mark.parametrize("name", LEGACY)
def test_a_malformed_legacy_file_is_refused_by_its_section(tmp_path, name):
    sections, words = LEGACY[name]
    path = tmp_path / "mesh.vtk"
    path.write_text(f"# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\n{sections}")
    with pytest.raises(MeshFileError) as raised:
        read_mesh(path)
    assert words in str(raised.value)


def xml_file(points, *, attributes="", count="3", before=""):
    """A triangle with these encoded points."""
    arrays = (
        '<Polys><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2</DataArray><DataArray type="Int64" '
    )
    arrays += 'Name="offsets" format="ascii">3</DataArray></Polys>'
    piece = f'<Piece NumberOfPoints="{count}" NumberOfPolys="1"><Points><DataArray type="Float32" '
    piece += f'NumberOfComponents="3" format="binary">{points.decode()}</DataArray></Points>{arrays}</Piece>'
    start = f'<?xml version="1.0"?>{before}<VTKFile type="PolyData" byte_order="LittleEndian" header_type="UInt64" '
    return f"{start}{attributes}><PolyData>{piece}</PolyData></VTKFile>"


def encoded(*head, rest=b"", packed=b""):
    return base64.b64encode(struct.pack(f"<{len(head)}Q", *head) + rest) + base64.b64encode(packed)


ZLIB = 'compressor="vtkZLibDataCompressor"'
SOUND = encoded(36, rest=np.eye(3, dtype="<f4").tobytes())
BLOCK = zlib.compress(bytes(1 << 20), 9)
XML = {
    "sound": (xml_file(SOUND), ""),
    "points beyond the file": (xml_file(b"", count="99999999999"), "has an array of shape (0, 3) for 99999999999"),
    "a count with a space": (xml_file(SOUND, count=" 99999999999"), "for 99999999999 points"),
    "a count with a sign": (xml_file(SOUND, count="+3"), "'NumberOfPoints' is '+3', not a count"),
    "a count in an entity": (xml_file(SOUND, count="&#57;9999999999"), "for 99999999999 points"),
    "bytes beyond the file": (xml_file(encoded(1 << 45, rest=bytes(36))), "declares 35184372088840 bytes"),
    "blocks beyond the file": (xml_file(encoded(1 << 62, packed=BLOCK), attributes=ZLIB), "bytes, but only"),
    "a block larger than declared": (
        xml_file(encoded(1, 36, 36, len(BLOCK), packed=BLOCK), attributes=ZLIB),
        "a block does not have its 36 bytes",
    ),
    "a decompression bomb": (
        xml_file(encoded(4000, 1 << 20, 0, *[len(BLOCK)] * 4000, packed=BLOCK * 4000), attributes=ZLIB),
        "unpacks to over 200 times its size",
    ),
    "a block larger than memory": (
        xml_file(encoded(1, 1 << 40, 1 << 40, len(BLOCK), packed=BLOCK), attributes=ZLIB),
        "unpacks to over 200 times its size",
    ),
    "damaged blocks": (xml_file(encoded(1, 36, 36, 40, packed=bytes(40)), attributes=ZLIB), "cannot be read (Error -3"),
    "an unknown compressor": (
        xml_file(encoded(1, 36, 36, 40, packed=bytes(40)), attributes='compressor="x"'),
        "'x' is not a supported compressor",
    ),
    "entities": (xml_file(SOUND, before='<!DOCTYPE l [<!ENTITY a "a">]>'), "declares a document type"),
    "a vertex beyond": (xml_file(SOUND).replace("0 1 2<", "0 1 99999999<"), "Polys: cell 0 has point 99999999 of 3"),
    "offsets beyond": (xml_file(SOUND).replace(">3<", ">99999999<"), "Polys: the offsets of the cells do not fit"),
    "appended bytes that are missing": (
        xml_file(SOUND).replace('format="binary"', 'format="appended" offset="9"'),
        "begins at byte 9 of 0",
    ),
    "unfinished": (xml_file(SOUND)[:-9], "its XML cannot be read"),
}


@pytest.mark.parametrize("name", XML)
def test_a_malformed_xml_file_is_refused_by_its_array(tmp_path, name):
    text, words = XML[name]
    path = tmp_path / "mesh.vtp"
    path.write_text(text)
    if words:
        with pytest.raises(MeshFileError) as raised:
            read_mesh(path)
        assert words in str(raised.value)
    else:
        assert np.array_equal(read_mesh(path).mesh.vertices, np.eye(3))
