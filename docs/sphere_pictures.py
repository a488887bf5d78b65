"""Draw the previews of docs/sphere_sets.md into docs/images: `python docs/sphere_pictures.py [MESH_FOLDER]`.

Meshes that are not there are left out, with a line that says so.
"""

import sys
import tempfile
from pathlib import Path

from PIL import Image

from coslobe.core.device import open_device
from coslobe.spheresets.fit import cached_spheres
from coslobe.spheresets.mesh import load_mesh
from coslobe.spheresets.preview import write_preview
from coslobe.spheresets.settings import FitSettings

IMAGES = Path(__file__).parent / "images"
MESHES = Path(__file__).parents[2] / "shared" / "data" / "meshes"
PICTURES = (
    ("bunny", "sample:bunny", 16),
    ("bunny", "sample:bunny", 64),
    ("bunny", "sample:bunny", 256),
    ("suzanne", "suzanne_pmndrs.glb", 64),
    ("penguin", "penguin.obj", 64),
    ("goathead", "goathead.obj", 64),
    ("fox", "Fox.glb", 64),
)
WIDTH = 820


def draw(source: str, count: int, target: Path) -> None:
    """Fit and write the preview, smaller and with a palette: each file stays below 150 kB."""
    mesh = load_mesh(source)
    tree = cached_spheres(mesh, FitSettings(count), device=open_device())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "preview.png")
        write_preview(path, mesh, tree.finest)
        picture = Image.open(path).convert("RGB")
    size = (WIDTH, round(picture.height * WIDTH / picture.width))
    small = picture.resize(size, Image.Resampling.LANCZOS)
    # The octree keeps the rare colours of the differences, which the default would blend with others.
    small.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(target, optimize=True)
    print(f"{target}: {target.stat().st_size / 1000:.0f} kB")


def main() -> None:
    """Write every picture."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else MESHES
    for name, file, count in PICTURES:
        source = file if file.startswith("sample:") else str(folder / file)
        if source != file and not Path(source).is_file():
            print(f"{source} is not there and left out")
            continue
        draw(source, count, IMAGES / f"spheres_{name}_{count}.png")


if __name__ == "__main__":
    main()
