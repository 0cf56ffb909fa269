"""OBJ files for batches."""

import hashlib
import json
import zipfile

import numpy as np


def circle(points=12, seed=0):
    """A curve around a saddle, not quite regular."""
    random = np.random.default_rng(seed)
    t = 2 * np.pi * (np.arange(points) + 0.2 * random.random(points)) / points
    return np.stack([np.cos(t), random.uniform(0.7, 1) * np.sin(t), random.uniform(0.1, 0.4) * np.cos(2 * t)], axis=1)


def vertex_lines(points):
    return "".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in points.tolist())


def curve_text(points, *, closed=True):
    numbers = [*range(1, len(points) + 1), *([1] if closed else [])]
    return vertex_lines(points) + "l " + " ".join(map(str, numbers)) + "\n"


def holed_text():
    """A pyramid without its base, in two groups, with Windows line ends."""
    text = "o roof\nv 0 0 0\nv 1 0 0\nv 1 1 0.1\nv 0 1 0\nv 0.5 0.5 1\n"
    text += "g south\nf 1 2 5\nf 2 3 5\ng north\nf -3 -2 -1\nf 4 1 5\n"
    return text.replace("\n", "\r\n")


def write_curves(folder, count, *, points=12):
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"curve{number:03}.obj" for number in range(count)]
    for number, path in enumerate(paths):
        path.write_text(curve_text(circle(points, number)))
    return paths


def packed_zip(path, entries):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries:
            archive.writestr(name, data)
    return path


def without_seconds(value):
    if isinstance(value, dict):
        return {key: without_seconds(part) for key, part in value.items() if key not in ("timings", "seconds")}
    return [without_seconds(part) for part in value] if isinstance(value, list) else value


def results(output, *, only=None):
    """Checksums of all results of a batch; of records without the seconds."""
    found = {}
    for path in sorted((output / "files").rglob("*")):
        if path.is_file():
            data = path.read_bytes()
            if path.name == "record.json":
                data = json.dumps(without_seconds(json.loads(data))).encode()
            found[str(path.relative_to(output / "files"))] = hashlib.sha256(data).hexdigest()
    return found


def record(output, key):
    return json.loads((output / "files" / key / "record.json").read_text())
