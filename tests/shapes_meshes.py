"""Triangle meshes with few vertices, as CAD programs write them, and denser ones."""

import numpy as np

from quadriform.shapes.mesh import Mesh

BOX_FACES = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4]]
BOX_FACES += [[1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7]]


def box_mesh(size=(10.0, 20.0, 30.0)):
    """A closed block of 8 vertices and 12 triangles."""
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    unit = np.vstack([np.column_stack([square, np.full(4, z)]) for z in (0.0, 1.0)])
    return Mesh(unit * size, np.array(BOX_FACES))


def prism_mesh(sides=64, radius=10.0, height=60.0):
    """A closed prism: two rings, two centres, long thin triangles between the rings."""
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.column_stack([np.cos(turn), np.sin(turn)])
    rings = [np.column_stack([ring, np.full(sides, z)]) for z in (0.0, height)]
    vertices = np.vstack([*rings, [[0, 0, 0], [0, 0, height]]])
    a = np.arange(sides)
    b = (a + 1) % sides
    low, high = np.full(sides, 2 * sides), np.full(sides, 2 * sides + 1)
    strips = [(a, b, b + sides), (a, b + sides, a + sides), (low, b, a), (high, a + sides, b + sides)]
    return Mesh(vertices, np.concatenate([np.column_stack(strip) for strip in strips]))


def cone_mesh(sides=64, radius=10.0, height=20.0):
    """A closed cone: a ring, the centre of its base, the tip."""
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    a = np.arange(sides)
    b = (a + 1) % sides
    base, tip = np.full(sides, sides), np.full(sides, sides + 1)
    faces = np.concatenate([np.column_stack([base, b, a]), np.column_stack([tip, a, b])])
    return Mesh(np.vstack([ring, [[0, 0, 0], [0, 0, height]]]), faces)


def dense_dome(rings=40, sides=80, radius=10.0):
    """A half sphere of small triangles, its flat base closed by large ones that meet in one vertex."""
    up = np.pi / 2 * np.arange(rings) / rings
    turn = 2 * np.pi * np.arange(sides) / sides
    z, r = np.sin(up)[:, None] + 0 * turn, np.cos(up)[:, None] + 0 * turn
    grid = radius * np.stack([r * np.cos(turn), r * np.sin(turn), z], axis=-1).reshape(-1, 3)
    vertices = np.vstack([grid, [[0, 0, radius], [0, 0, 0]]])
    top, base, b = rings * sides, rings * sides + 1, (np.arange(sides) + 1) % sides
    faces = []
    for k in range(rings - 1):
        low, high = k * sides, (k + 1) * sides
        a = np.arange(sides)
        faces += [np.column_stack([low + a, low + b, high + b]), np.column_stack([low + a, high + b, high + a])]
    a = np.arange(sides)
    faces.append(np.column_stack([(rings - 1) * sides + a, (rings - 1) * sides + b, np.full(sides, top)]))
    faces.append(np.column_stack([b, a, np.full(sides, base)]))
    return Mesh(vertices, np.concatenate(faces))
