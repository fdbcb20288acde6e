"""Buildings of others without a pattern: drawn meshes of plain colours, a default patrol in each, one line per building.

    python tests/benchmarks/plain_buildings.py --seeds 0-11 --out runs/plain
    python tests/benchmarks/plain_buildings.py --seeds 10000-10011 --out runs/judged odometry=fused

Number n draws an office, a hall, a carpark, an L of two halls, a T of two corridors or a home (n modulo six), turned by
any angle, with or without furniture and skirting, walls of one colour or of several, as OBJ, GLB, STL, COLLADA or SDF boxes.
Words behind are those of a run. Writes plain.csv beside the runs. Numbers below 10000 are for building and tuning, those
from 10000 on for judging only.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from shared import write

from rhs.base.provenance import commit
from rhs.runfolder.row import read_row

FORMATS = ("obj", "glb", "stl", "dae", "sdf")
HEIGHT_M, THICK_M, DOOR_M, LINTEL_M = 2.7, 0.15, 0.95, 2.1
FIGURES = ("places_total", "places_visited", "collisions", "belief_wrong_sure_share", "ate_rmse_m", "lost_share",
           "wall_ms")


@dataclass
class Drawing:
    """boxes: centre (3,), size (3,) in metres and what it is made of: floor, wall, skirting, furniture."""

    rng: np.random.Generator
    boxes: list[tuple[np.ndarray, np.ndarray, str]] = field(default_factory=list)

    def box(self, low: tuple[float, float, float], high: tuple[float, float, float], what: str) -> None:
        low_m, high_m = np.minimum(low, high), np.maximum(low, high)
        self.boxes.append((0.5 * (low_m + high_m), high_m - low_m, what))

    def room(self, low: tuple[float, float], high: tuple[float, float]) -> None:
        """The floor of a rectangle, under its walls too."""
        self.box((low[0] - THICK_M, low[1] - THICK_M, -0.1), (high[0] + THICK_M, high[1] + THICK_M, 0.0), "floor")

    def wall(self, start: tuple[float, float], end: tuple[float, float], doors: tuple[float, ...] = (),
             wide: float = DOOR_M) -> None:
        """Along x or y, with gaps of `wide` about `doors` (metres from its start)."""
        a, b = np.array(start), np.array(end)
        length = float(np.abs(b - a).max())
        along = (b - a) / length
        edges = [-THICK_M / 2, *(e for d in sorted(doors) for e in (d - wide / 2, d + wide / 2)), length + THICK_M / 2]
        side = THICK_M / 2 * np.abs(along[::-1])
        for k, (s, e) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
            low = LINTEL_M if k % 2 else 0.0
            self.box((*(a + s * along - side), low), (*(a + e * along + side), HEIGHT_M), "wall")
            if not k % 2:
                grow = side + 0.01 * np.abs(along[::-1])
                self.box((*(a + s * along - grow), 0.0), (*(a + e * along + grow), 0.1), "skirting")

    def frame(self, low: tuple[float, float], high: tuple[float, float]) -> None:
        """The four walls of a rectangle."""
        (x0, y0), (x1, y1) = low, high
        for start, end in (((x0, y0), (x1, y0)), ((x0, y1), (x1, y1)), ((x0, y0), (x0, y1)), ((x1, y0), (x1, y1))):
            self.wall(start, end)

    def stand(self, at: tuple[float, float], size: tuple[float, float, float]) -> None:
        x, y = at
        self.box((x - size[0] / 2, y - size[1] / 2, 0.0), (x + size[0] / 2, y + size[1] / 2, size[2]), "furniture")


def office(d: Drawing) -> None:
    """Rooms on both sides of a corridor."""
    rooms, wide = int(d.rng.integers(3, 5)), d.rng.uniform(3.6, 5.0)
    deep, corridor = d.rng.uniform(3.2, 4.5), d.rng.uniform(1.6, 2.4)
    length = rooms * wide
    top = deep + corridor
    d.room((0, 0), (length, top + deep))
    d.frame((0, 0), (length, top + deep))
    for y in (deep, top):
        d.wall((0, y), (length, y), tuple(wide * (k + d.rng.uniform(0.3, 0.7)) for k in range(rooms)))
        for k in range(1, rooms):
            d.wall((k * wide, 0 if y == deep else top), (k * wide, deep if y == deep else top + deep))
    for k in range(rooms):
        d.stand((wide * (k + 0.5), 0.5), (1.2, 0.6, 0.75))
        d.stand((wide * (k + 0.2), top + deep - 0.4), (0.8, 0.4, 1.8))


def hall(d: Drawing) -> None:
    """One large room, a few pillars and shelves."""
    x, y = d.rng.uniform(12, 22), d.rng.uniform(9, 16)
    d.room((0, 0), (x, y))
    d.frame((0, 0), (x, y))
    for _ in range(int(d.rng.integers(3, 7))):
        d.stand((d.rng.uniform(2, x - 2), d.rng.uniform(2, y - 2)), (0.4, 0.4, HEIGHT_M))
    for _ in range(3):
        d.stand((d.rng.uniform(1.5, x - 1.5), 0.4), (1.6, 0.5, 1.6))


def carpark(d: Drawing) -> None:
    """A grid of pillars, cars beside them."""
    nx, ny, step = int(d.rng.integers(3, 5)), int(d.rng.integers(2, 4)), d.rng.uniform(5.0, 6.5)
    d.room((0, 0), (nx * step, ny * step))
    d.frame((0, 0), (nx * step, ny * step))
    for i in range(1, nx):
        for j in range(1, ny):
            d.box((i * step - 0.25, j * step - 0.25, 0), (i * step + 0.25, j * step + 0.25, HEIGHT_M), "wall")
    for i in range(nx):
        if d.rng.random() < 0.6:
            d.stand((step * (i + 0.5), 2.6), (1.8, 4.2, 1.4))


def ell(d: Drawing) -> None:
    """Two halls at a right angle."""
    x, y, a, b = d.rng.uniform(11, 18), d.rng.uniform(10, 16), d.rng.uniform(3.5, 6), d.rng.uniform(3.5, 6)
    d.room((0, 0), (x, b))
    d.room((0, b), (a, y))
    for start, end in (((0, 0), (x, 0)), ((x, 0), (x, b)), ((a, b), (x, b)), ((a, b), (a, y)), ((0, y), (a, y)),
                       ((0, 0), (0, y))):
        d.wall(start, end)
    d.stand((x - 0.8, b / 2), (0.6, 1.4, 0.9))
    d.stand((a / 2, y - 0.8), (1.4, 0.6, 1.7))


def tee(d: Drawing) -> None:
    """Two corridors that meet."""
    x, y, w = d.rng.uniform(12, 18), d.rng.uniform(7, 12), d.rng.uniform(1.8, 3.0)
    m = x * d.rng.uniform(0.35, 0.65)
    d.room((0, 0), (x, w))
    d.room((m, w), (m + w, y))
    for start, end in (((0, 0), (x, 0)), ((0, 0), (0, w)), ((x, 0), (x, w)), ((0, w), (m, w)), ((m + w, w), (x, w)),
                       ((m, w), (m, y)), ((m + w, w), (m + w, y)), ((m, y), (m + w, y))):
        d.wall(start, end)
    d.stand((1.0, 0.35), (0.8, 0.4, 1.0))
    d.stand((x - 2.0, w - 0.35), (1.2, 0.4, 1.9))


def home(d: Drawing) -> None:
    """Six rooms with doors between them."""
    x, y = d.rng.uniform(9, 13), d.rng.uniform(7, 9)
    cuts, middle = (x * d.rng.uniform(0.28, 0.36), x * d.rng.uniform(0.62, 0.7)), y * d.rng.uniform(0.45, 0.55)
    d.room((0, 0), (x, y))
    d.frame((0, 0), (x, y))
    d.wall((0, middle), (x, middle), (cuts[0] * 0.5, 0.5 * (cuts[0] + cuts[1]), 0.5 * (cuts[1] + x)))
    for cut in cuts:
        d.wall((cut, 0), (cut, middle), (middle * d.rng.uniform(0.35, 0.6),))
        d.wall((cut, middle), (cut, y))
    d.stand((0.6, 1.2), (0.8, 1.8, 0.5))
    d.stand((x - 0.5, y - 1.0), (0.6, 1.6, 1.8))
    d.stand((0.5 * (cuts[0] + cuts[1]), y - 0.4), (1.5, 0.5, 0.9))


FAMILIES = (office, hall, carpark, ell, tee, home)


def draw(number: int, folder: Path) -> Path:
    """The file of building `number` in a folder."""
    rng = np.random.default_rng([14, number])
    drawing, kind = Drawing(rng), FORMATS[number % len(FORMATS)]
    FAMILIES[number % len(FAMILIES)](drawing)
    left_out = {what for what, chance in (("furniture", 0.4), ("skirting", 0.5)) if rng.random() < chance}
    angle = float(rng.uniform(0.0, 0.5 * np.pi)) if rng.random() < 0.75 else 0.0
    grey, several = rng.uniform(0.55, 0.9), rng.random() < 0.5
    shades = {"floor": np.full(3, grey - rng.uniform(0.05, 0.3)), "skirting": np.full(3, 0.35),
              "furniture": rng.uniform(0.2, 0.8, 3)}
    out = [(*box, rng.uniform(0.4, 0.95, 3) if several and box[2] == "wall" else shades.get(box[2], np.full(3, grey)))
           for box in drawing.boxes if box[2] not in left_out]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{FAMILIES[number % len(FAMILIES)].__name__}_{number}.{kind}"
    (write_sdf if kind == "sdf" else write_mesh)(path, out, angle)
    return path


def write_sdf(path: Path, boxes: list[tuple], angle: float) -> None:
    """A static model of boxes, ambient and diffuse colours."""
    links = []
    for k, (centre, size, _, colour) in enumerate(boxes):
        x, y = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ centre[:2]
        shape = f"<geometry><box><size>{' '.join(f'{v:.4f}' for v in size)}</size></box></geometry>"
        shade = " ".join(f"{v:.3f}" for v in colour) + " 1"
        links.append(f"<link name='b{k}'><pose>{x:.4f} {y:.4f} {centre[2]:.4f} 0 0 {angle:.6f}</pose>"
                     f"<collision name='c'>{shape}</collision><visual name='v'>{shape}<material><ambient>{shade}</ambient>"
                     f"<diffuse>{shade}</diffuse></material></visual></link>")
    path.write_text("<?xml version='1.0'?><sdf version='1.6'><world name='w'><model name='building'><static>true</static>"
                    + "".join(links) + "</model></world></sdf>\n")


def write_mesh(path: Path, boxes: list[tuple], angle: float) -> None:
    """One mesh per colour, in the axes that the format says."""
    turn = trimesh.transformations.rotation_matrix(angle, (0, 0, 1))
    if path.suffix in (".glb", ".dae"):
        turn = trimesh.transformations.rotation_matrix(-0.5 * np.pi, (1, 0, 0)) @ turn
    by_colour: dict[tuple[int, ...], list] = {}
    for centre, size, _, colour in boxes:
        solid = trimesh.creation.box(extents=size, transform=trimesh.transformations.translation_matrix(centre))
        solid.apply_transform(turn)
        by_colour.setdefault((*(int(255 * c) for c in colour), 255), []).append(solid)
    scene = trimesh.Scene()
    for shade, solids in by_colour.items():
        mesh = trimesh.util.concatenate(solids)
        physical = path.suffix in (".glb", ".dae")
        material = (trimesh.visual.material.PBRMaterial(baseColorFactor=shade, metallicFactor=0.0) if physical else
                    trimesh.visual.material.SimpleMaterial(diffuse=shade, name="m" + "_".join(map(str, shade))))
        mesh.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(mesh.vertices), 2)), material=material)
        scene.add_geometry(mesh)
    if path.suffix == ".stl":
        scene.to_geometry().export(path)
    elif path.suffix == ".dae":
        path.write_bytes(trimesh.exchange.dae.export_collada(list(scene.geometry.values())))
    elif path.suffix == ".obj":
        text, others = trimesh.exchange.obj.export_obj(scene, return_texture=True, mtl_name=path.stem + ".mtl")
        path.write_text(text)
        for name, data in others.items():
            (path.parent / name).write_bytes(data)
    else:
        scene.export(path)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="0-11", help="first-last, both included")
    parser.add_argument("--out", type=Path, default=Path("runs/plain"))
    parser.add_argument("--draw", action="store_true", help="draw them only")
    parser.add_argument("words", nargs="*", help="key=value words of a run")
    options = parser.parse_intermixed_args()
    first, _, last = options.seeds.partition("-")
    found = []
    for number in range(int(first), int(last or first) + 1):
        path = draw(number, options.out / "buildings")
        if options.draw:
            continue
        run = options.out / path.stem
        if not (run / "row.json").exists():
            words = [f"world={path}", f"output={run}", "recording=off", "pictures=off", *options.words]
            command = [sys.executable, "-m", "rhs", *words]
            subprocess.run(command, check=False, stdout=subprocess.DEVNULL)
        row = read_row(run / "row.json") if (run / "row.json").exists() else {"status": "no row"}
        found.append({"building": path.name, "status": row["status"], **{name: row.get(name) for name in FIGURES}})
        sys.stdout.write(" ".join(f"{v:.3g}" if isinstance(v, float) else str(v) for v in found[-1].values()) + "\n")
        sys.stdout.flush()
    if found:
        write(options.out / "plain.csv", found)
        sys.stdout.write(f"commit: {commit()}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
