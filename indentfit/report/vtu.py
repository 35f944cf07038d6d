"""Fields as VTU files for ParaView and the like: one file for each test, the quarter sample at the last displacement.

Points are undeformed, in mm ("warp by vector" with displacement_mm deforms them). Point arrays: displacement_mm,
cauchy_stress_kPa (xx yy zz xy yz xz), pressure_kPa (minus the mean normal stress, compression positive) and
contact_pressure_kPa (on the undeformed area; zero where nothing touches). Cell arrays, means of the element:
cauchy_stress_kPa, pressure_kPa, J; of a sample with layers layer (1 at the top; stresses at the nodes of an interface are means
of both sides); and, where the material has fibres, fibre (its direction in the undeformed sample) and fibre_deformed (F a0 in the
middle of the element: its length is the stretch along the fibre), of a second family fibre_2 and fibre_2_deformed.

Field data say what was computed: each parameter (mu_kPa), kappa_kPa, angle_deg, dip_deg and depth_mm; and as texts the test, the
material and indentfit's version, written as the codes of their letters: `bytes(array).decode()` reads them with every program.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import meshio
import numpy as np
from skfem.io.meshio import HEX_MAPPING

from indentfit.arrays import Array
from indentfit.fem.fields import Fields, pressure
from indentfit.fibre_map import FibreMap
from indentfit.fibres import Fibre

SPACE, STRESSES = ("x", "y", "z"), ("xx", "yy", "zz", "xy", "yz", "xz")
FACES = ([0, 3, 7, 4], [1, 2, 6, 5], [0, 1, 5, 4], [3, 2, 6, 7], [0, 1, 2, 3], [4, 5, 6, 7])  # by corners, in VTK's order
OPPOSITE = ((0, 1), (2, 3), (4, 5))  # faces
COMPONENTS = {
    "displacement_mm": SPACE,
    "fibre": SPACE,
    "fibre_deformed": SPACE,
    "fibre_2": SPACE,
    "fibre_2_deformed": SPACE,
    "cauchy_stress_kPa": ("xx", "yy", "zz", "xy", "yz", "xz"),
}
RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10))}  # on Windows


@dataclass(frozen=True, eq=False)
class Origin:
    """What fields were computed from: numbers and texts by name, and the direction of the fibres (3,), or of two families
    (2, 3), in the undeformed sample, or a map of them."""

    numbers: Mapping[str, float] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)
    fibre: Fibre | None = None


def write_vtu(path: Path, fields: Fields, origin: Origin | None = None) -> None:
    """Write fem.fields.Fields as one VTU file of eight-node or 27-node bricks, with what they were computed from."""
    origin = origin or Origin()
    kind = {8: "hexahedron", 27: "hexahedron27"}[fields.elements.shape[1]]
    cells = fields.elements[:, HEX_MAPPING[: fields.elements.shape[1]]]  # in VTK's order
    on_points = {
        "displacement_mm": fields.displacement,
        "cauchy_stress_kPa": fields.nodal_stress,
        "pressure_kPa": pressure(fields.nodal_stress),
        "contact_pressure_kPa": fields.contact_pressure,
    }
    on_cells = {
        "cauchy_stress_kPa": [fields.cell_stress],
        "pressure_kPa": [pressure(fields.cell_stress)],
        "J": [fields.volume_ratio],
    }
    if fields.layer is not None:
        on_cells["layer"] = [fields.layer.astype(np.int32)]
    for name, fibre in zip(("fibre", "fibre_2"), _on_cells(origin.fibre, fields.nodes[cells]), strict=False):
        on_cells[name] = [fibre]
        on_cells[f"{name}_deformed"] = [fibre + fibre_gradients(fields.nodes[cells], fields.displacement[cells], fibre)]
    mesh = meshio.Mesh(fields.nodes, [(kind, cells)], point_data=on_points, cell_data=on_cells)
    meshio.write(path, mesh, file_format="vtu")
    text = _with_fields(_with_components(path.read_text(encoding="utf-8")), origin)
    path.write_text(text, encoding="utf-8", newline="\n")


def _on_cells(fibre: Fibre | None, nodes: Array) -> list[Array]:
    """The directions (n, 3) of each family of fibres in the middle of bricks with these nodes (n, 8 or 27, 3)."""
    if fibre is None:
        return []
    if isinstance(fibre, FibreMap):
        return [fibre.at(nodes[:, :8].mean(axis=1).T).T]
    return [np.tile(family, (len(nodes), 1)) for family in np.atleast_2d(fibre)]


def fibre_gradients(nodes: Array, displacement: Array, fibre: Array) -> Array:
    """Derivative (n, 3) of the displacement along a direction (3,) or (n, 3) in the middle of bricks of 8 or 27 nodes.

    nodes, displacement : arrays (n, 8 or 27, 3) in VTK's order
    """
    X, u = (np.stack([_between_faces(values, *pair) for pair in OPPOSITE], axis=2) for values in (nodes, displacement))
    along = np.linalg.solve(X, np.broadcast_to(fibre[..., None], (len(X), 3, 1)))
    return np.asarray(u @ along)[:, :, 0]


def _between_faces(values: Array, first: int, second: int) -> Array:
    """Difference (n, 3) of values at the middles of two faces that lie opposite."""
    middles = [values[:, 20 + face] if values.shape[1] == 27 else values[:, FACES[face]].mean(axis=1) for face in (first, second)]
    return np.asarray(middles[1] - middles[0])


def _with_fields(text: str, origin: Origin) -> str:
    """The text of a VTU file with its field data, which meshio reads but does not write."""
    arrays = [_array("Float64", name, [f"{value:.17g}"]) for name, value in origin.numbers.items()]
    arrays += [_array("UInt8", name, map(str, value.encode())) for name, value in origin.texts.items() if value]
    if not arrays:
        return text
    return text.replace("<UnstructuredGrid>", f"<UnstructuredGrid><FieldData>{''.join(arrays)}</FieldData>", 1)


def _array(kind: str, name: str, values: Iterable[str]) -> str:
    listed = list(values)
    head = f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfTuples="{len(listed)}" format="ascii">'
    return f"\n{head}{' '.join(listed)}</DataArray>"


def _with_components(text: str) -> str:
    """The text of a VTU file with names of components, which meshio does not write and ParaView shows."""
    for name, components in COMPONENTS.items():
        words = " ".join(f'ComponentName{n}="{component}"' for n, component in enumerate(components))
        text = re.sub(rf'(<DataArray\b[^>]*\bName="{name}")', rf"\1 {words}", text)
    return text


def file_names(names: Sequence[str]) -> list[str]:
    """A file name (without ending) for each of the names of tests: safe on every system, and no two alike."""
    stems: list[str] = []
    for name in names:
        stem = re.sub(r"[^A-Za-z0-9._-]+", "-", name).strip("-.") or "test"
        if stem.split(".")[0].lower() in RESERVED:
            stem = f"test-{stem}"
        taken = {other.lower() for other in stems}
        choices = (stem if n == 1 else f"{stem}-{n}" for n in range(1, len(names) + 1))
        stems.append(next(choice for choice in choices if choice.lower() not in taken))
    return stems
