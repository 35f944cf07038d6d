"""Write the two shear curves of this case: straight lines of a shear stiffness that is known to 5 %.

python cases/white_matter_shear/make_curves.py

Each of the 5 points has the independent standard deviation with which their mean stiffness is known to 5 %.
"""

from pathlib import Path

CURVES = Path(__file__).parent / "curves"
STIFFNESS = {"shear_along": 1.27 * (1 + 0.68), "shear_across": 1.27}  # kPa
KNOWN_TO = 0.05
SHEARS = (0.02, 0.04, 0.06, 0.08, 0.10)


def main():
    for name, stiffness in STIFFNESS.items():
        own = KNOWN_TO * len(SHEARS) ** 0.5
        rows = [f"{g:g},{stiffness * g:.6g},{own * stiffness * g:.6g}" for g in SHEARS]
        (CURVES / f"{name}.csv").write_text("\n".join(["strain,stress_kPa,stress_sd_kPa", *rows]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
