"""How each material category is drawn: from a generator, a size and a base colour to a picture.

Every function returns colours (S, S, 3), about 0 to 1, that wrap around. The catalogue of colours and
sizes stands in ``textures``.
"""

import numpy as np

from langwm_data.scenes.patterns import Field, bond, grid, mix, noise, ramp, stones


def color(text: str) -> Field:
    """A colour from six hexadecimal digits, each channel 0 to 1."""
    return np.array([int(text[i : i + 2], 16) for i in (0, 2, 4)]) / 255


def _shade(image: Field, amount: Field) -> Field:
    """Lighten or darken: ``amount`` 0.1 is a tenth brighter."""
    return image * (1 + amount[..., None])


def _flat(size: int, base: Field) -> Field:
    return np.broadcast_to(base, (size, size, 3)).copy()


def _grain(rng: np.random.Generator, size: int, base: Field, contrast: float) -> Field:
    """Wood grain along u: growth rings cut lengthwise, and fine pores."""
    _, v = grid(size)
    warp = noise(rng, size, (1, 16), falloff=1.5, stretch=(5, 1))
    rings = np.sin(2 * np.pi * (rng.integers(4, 9) * v + rng.uniform(0.35, 0.8) * warp))
    pores = noise(rng, size, (4, 40), falloff=0.3, stretch=(8, 1))
    return _shade(_flat(size, base), contrast * (0.6 * rings + 0.45 * warp + 0.4 * pores))


def wood(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Sawn wood, the grain along u."""
    return _grain(rng, size, base, rng.uniform(0.08, 0.2))


def _boards(rng: np.random.Generator, size: int, base: Field, rows: int, columns: int) -> Field:
    """Rows of boards with gaps, each with its own tone and its own piece of grain."""
    u, v = grid(size)
    cells = bond(u, v, rows, columns, rng.uniform(0, 1, rows))
    grain = _grain(rng, size, base, rng.uniform(0.07, 0.14))
    offsets = rng.integers(0, size, (cells.count, 2))
    y, x = np.mgrid[:size, :size]
    moved = cells.per_cell(offsets)
    image = grain[(y + moved[..., 0]) % size, (x + moved[..., 1]) % size]
    image = _shade(image, cells.per_cell(rng.uniform(-0.16, 0.16, cells.count)))
    gap = 0.04 / rows
    return mix(image * rng.uniform(0.3, 0.5), image, ramp(cells.edge, gap, gap + 1.2 / size))


def wood_floor(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Narrow boards laid in rows, ends staggered at random."""
    return _boards(rng, size, base, rows=int(rng.choice([10, 12, 16])), columns=int(rng.choice([1, 2])))


def planks(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Wide boards, worn in places."""
    image = _boards(rng, size, base, rows=int(rng.choice([5, 6, 8])), columns=1)
    wear = ramp(noise(rng, size, (1, 14), stretch=(2, 1)), 0.6, 1.8)
    return mix(image, _shade(image, np.full((size, size), -0.4)), wear * rng.uniform(0.2, 0.9))


def _blocks(rng: np.random.Generator, size: int, base: Field, shape: tuple[int, int], joint: float) -> Field:
    """Bonded blocks; ``joint`` is half the width of the mortar, in units of the tile."""
    u, v = grid(size)
    rows, columns = shape
    cells = bond(u, v, rows, columns, np.tile([0.0, 0.5], rows // 2))
    image = _shade(_flat(size, base), cells.per_cell(rng.normal(0, rng.uniform(0.05, 0.16), cells.count)))
    image = _shade(image, 0.05 * noise(rng, size, (3, 30), falloff=0.5))
    mortar = color(str(rng.choice(["c9c2b6", "a8a49c", "dedad2", "6e6862"])))
    return mix(mortar, image, ramp(cells.edge, joint - 0.5 / size, joint + 1.0 / size))


def bricks(rng: np.random.Generator, size: int, base: Field) -> Field:
    """A running bond with mortar."""
    return _blocks(rng, size, base, (int(rng.choice([10, 12, 14])), int(rng.choice([4, 5]))), 0.006)


def tiles(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Square tiles with grout: plain, chequered, with inlays, or mixed at random."""
    u, v = grid(size)
    across = int(rng.choice([2, 4, 4, 6, 8]))
    cells = bond(u, v, across, across, np.full(across, 0.0))
    row, column = np.divmod(np.arange(cells.count), across)
    second = color(str(rng.choice(["f2efe8", "3b4248", "8fa3a8", "b5714a", "39516b"])))
    style = rng.integers(4)
    chosen = {
        0: np.zeros(cells.count),
        1: ((row + column) % 2).astype(float),
        2: ((row % 2) * (column % 2)).astype(float),
        3: np.where(rng.uniform(size=cells.count) < 0.3, 0.6, 0.0),
    }[int(style)]
    image = mix(base, second, cells.per_cell(chosen))
    image = _shade(image, cells.per_cell(rng.normal(0, 0.03, cells.count)) + 0.03 * noise(rng, size, (1, 8)))
    grout = color(str(rng.choice(["d8d5ce", "8b8881", "55524d"])))
    return mix(grout, image, ramp(cells.edge, 0.003, 0.003 + 1.2 / size))


def paving_stones(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Cut blocks or irregular flags."""
    if rng.uniform() < 0.5:
        rows = int(rng.choice([6, 8, 10]))
        return _blocks(rng, size, base, (rows, int(rng.choice([rows // 2, rows]))), 0.009)
    return _cobbles(rng, size, base, int(rng.integers(5, 9)), 0.35)


def _cobbles(rng: np.random.Generator, size: int, base: Field, across: int, depth: float) -> Field:
    """Rounded stones, darker towards the joints."""
    u, v = grid(size)
    cells = stones(rng, u, v, across)
    image = _shade(_flat(size, base), cells.per_cell(rng.normal(0, 0.14, cells.count)))
    image = _shade(image, 0.1 * noise(rng, size, (2, 32), falloff=0.7))
    return mix(image * (1 - 2 * depth), image, ramp(cells.edge, 0.0, 0.16 / across))


def rocks(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Large rough stones."""
    image = _cobbles(rng, size, base, int(rng.integers(3, 6)), 0.33)
    return _shade(image, 0.16 * noise(rng, size, (1, 24), falloff=0.9))


def ground(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Earth with pebbles."""
    u, v = grid(size)
    image = _shade(_flat(size, base), rng.uniform(0.12, 0.22) * noise(rng, size, (1, 36), falloff=0.6))
    cells = stones(rng, u, v, 14)
    pebble = cells.per_cell((rng.uniform(size=cells.count) < rng.uniform(0.03, 0.3)).astype(float))
    return mix(image, np.clip(base + 0.22, 0, 1), pebble * ramp(cells.edge, 0.008, 0.02))


def asphalt(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Fine grey speckle."""
    speckle = rng.uniform(0.1, 0.22) * noise(rng, size, (10, 44), falloff=0.0)
    return _shade(_flat(size, base), speckle + 0.08 * noise(rng, size, (1, 5)))


def concrete(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Clouded grey with pores, some with the seams of panels."""
    cloud = noise(rng, size, (1, 24), falloff=1.2)
    pores = ramp(noise(rng, size, (10, 40), falloff=0.2), 2.2, 3.2)
    image = _shade(_flat(size, base), rng.uniform(0.05, 0.12) * cloud - 0.25 * pores)
    if rng.uniform() < 0.4:
        u, v = grid(size)
        seam = bond(u, v, 2, 2, np.zeros(2)).edge
        image = mix(image * 0.7, image, ramp(seam, 0.002, 0.002 + 1.5 / size))
    return image


def plaster(rng: np.random.Generator, size: int, base: Field) -> Field:
    """The strokes of a trowel."""
    strokes = noise(rng, size, (4, 26), falloff=0.4, stretch=(rng.uniform(0.6, 1.0), rng.uniform(1.0, 2.0)))
    return _shade(_flat(size, base), rng.uniform(0.025, 0.05) * strokes + 0.02 * noise(rng, size, (1, 4)))


def paint(rng: np.random.Generator, size: int, base: Field) -> Field:
    """An even wall, almost without relief."""
    return _shade(_flat(size, base), 0.012 * noise(rng, size, (1, 20), falloff=0.6))


def marble(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Veins on a clouded ground."""
    cloud = noise(rng, size, (1, 10), falloff=1.4)
    veins = np.abs(noise(rng, size, (1, 20), falloff=2.0, stretch=(1.0, rng.uniform(1.0, 1.8))))
    fine = np.abs(noise(rng, size, (2, 24), falloff=1.7))
    vein_color = base + 0.45 if base.mean() < 0.45 else base * rng.uniform(0.4, 0.65)
    image = _shade(_flat(size, base), 0.05 * cloud)
    faint = mix(0.4 * vein_color + 0.6 * base, image, ramp(fine, 0.0, 0.2))
    return mix(vein_color, faint, ramp(veins, 0.0, rng.uniform(0.15, 0.35)))


def terrazzo(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Chips of stone in a polished ground."""
    u, v = grid(size)
    cells = stones(rng, u, v, int(rng.choice([12, 16, 20])))
    chips = np.stack([color(c) for c in ("f4efe6", "5b5f63", "b0603f", "d6a75c", "7f9488")])
    chips = np.clip(chips[rng.permutation(5)[:3]] * 0.8 + base * 0.2, 0, 1)
    kind = rng.integers(0, 5, cells.count)
    colors = np.concatenate([chips, [base, base]])[kind]
    image = mix(base, cells.per_cell(colors), ramp(cells.edge, 0.006, 0.006 + 1.2 / size))
    return _shade(image, 0.02 * noise(rng, size, (4, 30), falloff=0.0))


def fabric(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Crossing threads, plain or with stripes or checks in a second colour."""
    u, v = grid(size)
    threads = int(rng.choice([12, 16]))
    over = np.sin(2 * np.pi * threads * u) * np.sin(2 * np.pi * threads * v)
    second = np.clip(base * 0.55 if base.mean() > 0.4 else base + 0.35, 0, 1)
    bars = int(rng.choice([2, 3, 4, 6]))
    across, down = (ramp(np.sin(2 * np.pi * bars * x), -0.3, 0.3) for x in (u, v))
    style = int(rng.integers(4))
    weight = {0: 0 * u, 1: across, 2: 0.5 * (across + down), 3: 0 * u}[style]
    image = mix(base, second, weight)
    return _shade(image, rng.uniform(0.07, 0.14) * over + 0.05 * noise(rng, size, (4, 30), falloff=0.2))


def fabric_carpet(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Tufts, with a woven motif on some."""
    u, v = grid(size)
    second = np.clip(base * 0.5 if base.mean() > 0.4 else base + 0.3, 0, 1)
    count = int(rng.choice([2, 3, 4]))
    du, dv = (np.abs((x * count) % 1 - 0.5) for x in (u, v))
    diamond = ramp(du + dv, 0.42, 0.5) - ramp(du + dv, 0.58, 0.66)
    stripe = ramp(np.sin(2 * np.pi * count * v), 0.1, 0.5)
    weight = {0: 0 * u, 1: diamond, 2: stripe}[int(rng.integers(3))]
    tufts = noise(rng, size, (14, 44), falloff=0.0)
    return _shade(mix(base, second, weight), rng.uniform(0.08, 0.16) * tufts)


def leather(rng: np.random.Generator, size: int, base: Field) -> Field:
    """A net of fine creases."""
    u, v = grid(size)
    cells = stones(rng, u, v, int(rng.integers(11, 18)))
    crease = ramp(cells.edge, 0.0, 0.02)
    image = _shade(_flat(size, base), 0.1 * noise(rng, size, (1, 6)) + 0.05 * noise(rng, size, (3, 20)))
    return mix(image * rng.uniform(0.55, 0.75), image, crease)


def metal(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Brushed along u, some with rust."""
    brushed = noise(rng, size, (3, 48), falloff=0.2, stretch=(20, 1))
    sheen = noise(rng, size, (1, 3))
    image = _shade(_flat(size, base), rng.uniform(0.05, 0.14) * brushed + 0.08 * sheen)
    if rng.uniform() < 0.3:
        rust = ramp(noise(rng, size, (2, 20), falloff=1.0), 0.9, 1.8)
        image = mix(image, color("7a4a2b"), 0.6 * rust)
    return image


def metal_diamond_plate(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Raised lozenges, neighbours at right angles."""
    u, v = grid(size)
    count = int(rng.choice([4, 6, 8]))
    x, y = u * count, v * count
    turned = (np.floor(x) + np.floor(y)) % 2
    a, b = x % 1 - 0.5, y % 1 - 0.5
    along, across = np.where(turned, a + b, a - b), np.where(turned, a - b, a + b)
    lug = 1 - ramp((along / 0.62) ** 2 + (across / 0.2) ** 2, 0.5, 1.1)
    lit = ramp(-across - 0.3 * along, -0.1, 0.12)
    image = _shade(_flat(size, base), 0.05 * noise(rng, size, (1, 20), falloff=0.6))
    return _shade(image, lug * (0.75 * lit - 0.3))


def moss(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Clumps of green over earth."""
    clumps = noise(rng, size, (2, 40), falloff=0.5)
    image = _shade(_flat(size, base), rng.uniform(0.18, 0.3) * clumps)
    patches = ramp(noise(rng, size, (1, 8)), 0.6, 1.6)
    return mix(image, color("6b5b3a"), patches * rng.uniform(0.1, 0.7))


def plastic(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Moulded: smooth, ribbed or dimpled."""
    u, v = grid(size)
    count = int(rng.choice([4, 6, 8]))
    rib = np.sin(2 * np.pi * count * u)
    dimple = rib * np.sin(2 * np.pi * count * v)
    relief = {0: 0 * u, 1: rib, 2: dimple}[int(rng.integers(3))]
    return _shade(_flat(size, base), 0.09 * relief + 0.03 * noise(rng, size, (1, 4)))


def porcelain(rng: np.random.Generator, size: int, base: Field) -> Field:
    """Glazed, with painted rings or a net of fine cracks on some."""
    u, v = grid(size)
    image = _shade(_flat(size, base), 0.025 * noise(rng, size, (1, 5)))
    style = int(rng.integers(3))
    if style == 1:
        radius = np.hypot((u * 4) % 1 - 0.5, (v * 4) % 1 - 0.5)
        image = mix(image, color("3d5f9e"), 1 - ramp(np.abs(radius - 0.28), 0.03, 0.08))
    elif style == 2:
        image = mix(image * 0.82, image, ramp(stones(rng, u, v, 6).edge, 0.0, 0.012))
    return image
