"""Whether a picture still looks like the one that somebody has seen: both made small and grey, compared by tile."""

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

#: Pictures are compared at this width; a tile is so many pixels wide and high there.
WIDTH, TILE = 240, 8
#: Largest difference of grey (0…255) of the whole picture and of any tile: a clock may be another one, other fonts may
#: set a line otherwise; a panel that moved, a missing button or another colour may not.
MEAN_LIMIT, TILE_LIMIT = 7.0, 72.0


def small(png: bytes) -> NDArray[np.float64]:
    """Grey levels (rows, WIDTH)."""
    image = Image.open(io.BytesIO(png)).convert("L")
    height = round(image.height * WIDTH / image.width)
    return np.asarray(image.resize((WIDTH, height), Image.Resampling.BOX), dtype=float)


def keep(png: bytes, path: Path) -> None:
    """Writes the small picture that later ones are compared with."""
    Image.fromarray(small(png).astype(np.uint8)).save(path, optimize=True)


def differences(png: bytes, path: Path) -> tuple[float, float]:
    """Mean difference of grey, and that of the tile that differs most; infinite where the sizes differ."""
    now, then = small(png), np.asarray(Image.open(path), dtype=float)
    if now.shape != then.shape:
        return float("inf"), float("inf")
    rows, columns = (n // TILE * TILE for n in now.shape)
    apart = np.abs(now - then)[:rows, :columns]
    tiles = apart.reshape(rows // TILE, TILE, columns // TILE, TILE).mean(axis=(1, 3))
    return float(apart.mean()), float(tiles.max())


def is_alike(png: bytes, path: Path) -> bool:
    """Whether nothing has moved, gone or changed its colour."""
    mean, worst = differences(png, path)
    return mean <= MEAN_LIMIT and worst <= TILE_LIMIT
