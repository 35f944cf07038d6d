"""Fields as VTU files for ParaView and the like: one file for each test, the quarter sample at the last displacement.

Points are undeformed, in mm ("warp by vector" with displacement_mm deforms them). Point arrays: displacement_mm,
cauchy_stress_kPa (xx yy zz xy yz xz), pressure_kPa (minus the mean normal stress, compression positive) and
contact_pressure_kPa (on the undeformed area; zero where nothing touches). Cell arrays, means of the element:
cauchy_stress_kPa, pressure_kPa, J.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import meshio
from skfem.io.meshio import HEX_MAPPING

from indentfit.fem.fields import Fields, pressure

COMPONENTS = {"displacement_mm": ("x", "y", "z"), "cauchy_stress_kPa": ("xx", "yy", "zz", "xy", "yz", "xz")}
RESERVED = {"con", "prn", "aux", "nul", *(f"{port}{n}" for port in ("com", "lpt") for n in range(10))}  # on Windows


def write_vtu(path: Path, fields: Fields) -> None:
    """Write fem.fields.Fields as one VTU file of eight-node or 27-node bricks."""
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
    mesh = meshio.Mesh(fields.nodes, [(kind, cells)], point_data=on_points, cell_data=on_cells)
    meshio.write(path, mesh, file_format="vtu")
    path.write_text(_with_components(path.read_text(encoding="utf-8")), encoding="utf-8", newline="\n")


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
