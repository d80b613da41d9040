"""Procedural textures for the simulated cell: sRGB pictures made from noise and rectangles.

Every function returns an ``(n, m, 3) uint8`` sRGB picture and takes the random generator that
decides it, so that a cell can be rebuilt from its seed without any file.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

Colour = Sequence[float] | np.ndarray


def fractal_noise(
    shape: tuple[int, int],
    rng: np.random.Generator,
    *,
    slope: float = 1.0,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> np.ndarray:
    """Tileable noise with a power-law amplitude spectrum.

    Args:
        shape: (rows, columns) of the result.
        rng: source of randomness.
        slope: amplitude falls as frequency ** -slope; 0 is white noise, 2 is cloudy.
        stretch: (row, column) factors by which features are elongated.

    Returns:
        ``shape`` float64 with zero mean and unit standard deviation.
    """
    rows, columns = shape
    fy = np.fft.fftfreq(rows)[:, None] * rows * stretch[0]
    fx = np.fft.rfftfreq(columns)[None] * columns * stretch[1]
    radius = np.hypot(fy, fx)
    radius[0, 0] = 1.0
    spectrum = np.fft.rfft2(rng.standard_normal(shape)) / radius**slope
    spectrum[0, 0] = 0.0
    noise = np.fft.irfft2(spectrum, s=shape)
    return noise / max(float(noise.std()), 1e-12)


def _to_uint8(rgb: np.ndarray) -> np.ndarray:
    return np.clip(np.round(rgb * 255.0), 0, 255).astype(np.uint8)


def _tinted(colour: Colour, shade: np.ndarray) -> np.ndarray:
    """``colour`` (sRGB 0-1) multiplied by a (H, W) shade around 1."""
    return _to_uint8(np.asarray(colour, float) * shade[..., None])


def paint(rng: np.random.Generator, colour: Colour, size: int = 512) -> np.ndarray:
    """A painted wall: an even colour with faint stains and roller grain."""
    stains = 0.018 * fractal_noise((size, size), rng, slope=1.6)
    grain = 0.010 * fractal_noise((size, size), rng, slope=0.3)
    return _tinted(colour, 1.0 + stains + grain)


def concrete(rng: np.random.Generator, colour: Colour, size: int = 512) -> np.ndarray:
    """Concrete or linoleum: cloudy, with fine dark specks."""
    cloud = 0.07 * fractal_noise((size, size), rng, slope=1.3)
    specks = np.where(fractal_noise((size, size), rng, slope=0.4) > 2.2, -0.16, 0.0)
    return _tinted(colour, 1.0 + cloud + specks)


def wood(rng: np.random.Generator, colour: Colour, size: int = 1024) -> np.ndarray:
    """Planks with growth rings; the grain runs along the columns."""
    warp = fractal_noise((size, size), rng, slope=1.7, stretch=(1.0, 6.0))
    fibre = fractal_noise((size, size), rng, slope=0.7, stretch=(1.0, 40.0))
    planks = int(rng.integers(3, 7))
    row = np.arange(size)[:, None] / size
    rings = np.sin(2 * np.pi * (row * rng.integers(14, 30) + 1.4 * warp))
    tone = rng.normal(0.0, 0.06, planks)[np.minimum((row * planks).astype(int), planks - 1)]
    shade = 0.95 + 0.09 * rings + 0.05 * fibre + tone
    shade[np.abs((row[:, 0] * planks) % 1.0) < 0.010] *= 0.55
    return _tinted(colour, shade)


def checker(rng: np.random.Generator, first: Colour, second: Colour, size: int = 512) -> np.ndarray:
    """Checkerboard of 8 x 8 fields with worn surfaces."""
    index = np.arange(size) * 8 // size
    even = ((index[:, None] + index[None]) % 2 == 0)[..., None]
    base = np.where(even, np.asarray(first, float), np.asarray(second, float))
    wear = 1.0 + 0.05 * fractal_noise((size, size), rng, slope=1.2)
    return _to_uint8(base * wear[..., None])


def tiles(rng: np.random.Generator, colour: Colour, size: int = 512) -> np.ndarray:
    """Square tiles with darker joints, each tile a little different."""
    count = int(rng.integers(4, 9))
    position = np.arange(size) * count / size
    tile = position.astype(int)
    tone = 1.0 + 0.06 * rng.standard_normal((count, count))[np.ix_(tile, tile)]
    joint = np.abs(position - tile - 0.5) > 0.475
    shade = tone + 0.03 * fractal_noise((size, size), rng, slope=1.0)
    shade = np.where(joint[:, None] | joint[None], 0.62, shade)
    return _tinted(colour, shade)


def bricks(rng: np.random.Generator, colour: Colour, size: int = 768) -> np.ndarray:
    """A running-bond brick wall, 12 courses of 6 bricks."""
    courses, per_course = 12, 6
    row = np.arange(size)[:, None] * courses / size
    course = row.astype(int)
    column = (np.arange(size)[None] * per_course / size + 0.5 * (course % 2)) % per_course
    brick = column.astype(int)
    tone = 1.0 + 0.13 * rng.standard_normal((courses, per_course))[course, brick]
    mortar = (np.abs(row - course - 0.5) > 0.44) | (np.abs(column - brick - 0.5) > 0.47)
    shade = tone + 0.06 * fractal_noise((size, size), rng, slope=0.8)
    rgb = np.asarray(colour, float) * shade[..., None]
    grey = 0.66 + 0.05 * fractal_noise((size, size), rng, slope=0.6)
    return _to_uint8(np.where(mortar[..., None], grey[..., None], rgb))


def carpet(rng: np.random.Generator, colour: Colour, size: int = 512) -> np.ndarray:
    """Coarse woven carpet."""
    weave = 0.10 * fractal_noise((size, size), rng, slope=0.15)
    cloud = 0.04 * fractal_noise((size, size), rng, slope=1.2)
    return _tinted(colour, 1.0 + weave + cloud)


def brushed(rng: np.random.Generator, colour: Colour, size: int = 512) -> np.ndarray:
    """Brushed metal: streaks along the columns."""
    streaks = fractal_noise((size, size), rng, slope=0.5, stretch=(1.0, 60.0))
    return _tinted(colour, 1.0 + 0.05 * streaks)


def cardboard(rng: np.random.Generator, size: int = 512) -> np.ndarray:
    """A parcel's side: brown board with tape and perhaps a label."""
    fibre = fractal_noise((size, size), rng, slope=0.5, stretch=(8.0, 1.0))
    cloud = fractal_noise((size, size), rng, slope=1.5)
    board = np.array([0.69, 0.52, 0.36]) * rng.uniform(0.85, 1.1)
    picture = _tinted(board, 1.0 + 0.02 * fibre + 0.04 * cloud)
    tape = rng.integers(size // 3, size // 2)
    picture[tape : tape + size // 9] = picture[tape : tape + size // 9] * 0.6 + 78
    if rng.random() < 0.7:
        _paste_label(picture, rng)
    return picture


def _paste_label(picture: np.ndarray, rng: np.random.Generator) -> None:
    size = picture.shape[0]
    width, height = int(size * rng.uniform(0.25, 0.45)), int(size * rng.uniform(0.18, 0.3))
    x, y = int(rng.integers(0, size - width)), int(rng.integers(0, size - height))
    label = np.full((height, width, 3), 238, np.uint8)
    _write_lines(label, rng, (30, 30, 34), top=height // 6)
    bars = np.repeat(rng.random(width // 3) < 0.5, 3)[: width - 16]
    label[-height // 3 : -6, 8 : 8 + len(bars)][:, bars] = 25
    picture[y : y + height, x : x + width] = label


def _write_lines(
    picture: np.ndarray, rng: np.random.Generator, ink: tuple[int, int, int], top: int
) -> None:
    """Lines of text seen from too far away to be read: runs of small blocks."""
    height, width = picture.shape[:2]
    pitch = max(4, height // int(rng.integers(9, 22)))
    margin = width // 12
    for y in range(top, height - pitch, pitch):
        x, end = margin, int(width - margin - rng.uniform(0, 0.5) * width)
        while x < end:
            word = int(rng.integers(pitch // 2, 4 * pitch))
            cv2.rectangle(picture, (x, y), (min(x + word, end), y + max(pitch // 3, 1)), ink, -1)
            x += word + max(pitch // 3, 1)


def _photo(rng: np.random.Generator, size: int) -> np.ndarray:
    """Something like a landscape out of focus: mostly light and dark, some colour."""
    light = fractal_noise((size, size), rng, slope=1.5)
    tint = np.stack([fractal_noise((size, size), rng, slope=2.0) for _ in range(3)], axis=-1)
    row = np.linspace(0.75, 0.3, size)[:, None, None]
    sky, ground = rng.uniform(0.5, 0.9, 3), rng.uniform(0.15, 0.5, 3)
    return _to_uint8(row * sky + (1 - row) * ground + 0.13 * light[..., None] + 0.05 * tint)


def poster(rng: np.random.Generator, size: int = 512) -> np.ndarray:
    """A notice or poster: coloured ground, a picture, a headline and lines of text."""
    paper = rng.uniform(0.75, 0.97, 3) if rng.random() < 0.65 else rng.uniform(0.1, 0.6, 3)
    picture = _tinted(paper, np.ones((size, size)))
    ink = (24, 24, 28) if paper.mean() > 0.5 else (236, 236, 232)
    band = tuple(int(v) for v in rng.integers(20, 220, 3))
    cv2.rectangle(picture, (0, 0), (size, int(size * rng.uniform(0.08, 0.2))), band, -1)
    words = ("NOTICE", "LAB 3", "SAFETY", "ROBOT", "EXIT", "CAUTION", "MEETING", "PLAN")
    text = str(rng.choice(words))
    cv2.putText(
        picture, text, (size // 12, size // 3), cv2.FONT_HERSHEY_DUPLEX, size / 210, ink, 5, 16
    )
    half = size // 2
    photo = _photo(rng, half)
    left = int(rng.integers(0, size - half))
    picture[int(0.38 * size) : int(0.38 * size) + half, left : left + half] = photo
    _write_lines(picture[int(0.88 * size) :], rng, ink, top=4)
    return picture


def screen(rng: np.random.Generator, size: int = 512) -> np.ndarray:
    """A computer screen: dark or light windows with text and a plot."""
    dark = rng.random() < 0.5
    picture = np.full((size, size, 3), 28 if dark else 205, np.uint8)
    for _ in range(int(rng.integers(2, 5))):
        x, y = (int(v) for v in rng.integers(0, size // 2, 2))
        w, h = (int(v) for v in rng.integers(size // 4, size // 2, 2))
        window = picture[y : y + h, x : x + w]
        window[:] = rng.integers(15, 60, 3) if dark else rng.integers(215, 255, 3)
        window[: size // 32] = rng.integers(60, 180, 3)
        ink = rng.integers(120, 255, 3) if dark else rng.integers(0, 90, 3)
        _write_lines(window, rng, (int(ink[0]), int(ink[1]), int(ink[2])), top=size // 20)
    return picture


def bookshelf(rng: np.random.Generator, size: int = 768) -> np.ndarray:
    """Shelves with coloured spines, boxes and gaps."""
    shelves = int(rng.integers(3, 6))
    pitch = size // shelves
    picture = np.full((size, size, 3), 38, np.uint8)
    board = rng.integers(90, 225, 3)
    for shelf in range(shelves):
        bottom = (shelf + 1) * pitch - pitch // 12
        x = 0
        while x < size:
            width = int(rng.integers(pitch // 14, pitch // 4))
            if rng.random() < 0.82:
                top = bottom - int(pitch * rng.uniform(0.5, 0.85))
                colour = np.clip(rng.uniform(20, 220) + 45 * rng.uniform(-1, 1, 3), 10, 235)
                picture[top:bottom, x : x + width - 1] = colour
                mark = top + (bottom - top) // 5
                picture[mark : mark + pitch // 12, x + 1 : x + width - 2] = 255 - colour
            x += width
        picture[bottom : bottom + pitch // 12] = board
    return picture


def cabinet(rng: np.random.Generator, colour: Colour, size: int = 512) -> np.ndarray:
    """A cabinet front: doors or drawers with gaps and handles."""
    picture = paint(rng, colour, size)
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    for i in range(columns):
        for j in range(rows):
            x0, x1 = i * size // columns, (i + 1) * size // columns - 1
            y0, y1 = j * size // rows, (j + 1) * size // rows - 1
            cv2.rectangle(picture, (x0, y0), (x1, y1), (35, 35, 38), 3)
            cx, cy = (x0 + x1) // 2, y0 + (y1 - y0) // 5
            half = (x1 - x0) // 5
            cv2.line(picture, (cx - half, cy + 4), (cx + half, cy + 4), (45, 45, 48), 7)
            cv2.line(picture, (cx - half, cy), (cx + half, cy), (188, 190, 194), 5)
    return picture


def spots(rng: np.random.Generator, size: int = 384) -> np.ndarray:
    """A strongly patterned thing: dots or stripes of clashing colours."""
    ground, ink = rng.uniform(0.1, 0.95, 3), rng.uniform(0.05, 0.95, 3)
    if rng.random() < 0.5:
        stripe = np.sin(np.arange(size) * 2 * np.pi * rng.integers(3, 12) / size) > 0
        pattern = np.broadcast_to(stripe[:, None], (size, size))
    else:
        pattern = fractal_noise((size, size), rng, slope=1.8) > 0.3
    return _to_uint8(np.where(pattern[..., None], ink, ground))
