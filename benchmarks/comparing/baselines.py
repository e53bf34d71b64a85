"""How each baseline is called, tuned by hand to the errors of the closed surfaces; each is imported where it is used.

`HOW` is printed with the tables.
"""

import ctypes
from collections.abc import Callable
from functools import cache
from importlib import import_module
from types import ModuleType

import numpy as np
import trimesh

from comparing.harness import Missing

Surface = tuple[np.ndarray, np.ndarray]

DEPTH, COARSE, NEIGHBOURS = 6, 5, 30
CPD_STEPS, CPD_WIDTH = 30, 0.5
PYCPD_HOLD, PROBREG_HOLD = 0.5, 0.1

HOW = f"""\
- Open3D: `estimate_normals` of {NEIGHBOURS} neighbours, `orient_normals_consistent_tangent_plane(15)` and
  `create_from_point_cloud_poisson(depth={DEPTH})`, all inside the timed part, all cores. Depth 7 is slower and open
  at 20,000 points, depth 8 at 6,000 too. The goals refer to depth {DEPTH} (37,854 parameters, as in the benchmark
  data); depth {COARSE} is faster, and nearer on the noisy egg, so it has rows of its own, without a goal.
- pycpd and probreg: non-rigid CPD of an ellipsoid of 642 vertices, laid by the cloud's second moments, lengths in
  RMS radii; beta {CPD_WIDTH}, alpha {PYCPD_HOLD} (pycpd) and {PROBREG_HOLD} (probreg), at most {CPD_STEPS} steps,
  tolerance 1e-4. 50 steps give the same 0.31 and 0.33 RMS on the egg, tolerance 1e-3 leaves 0.38 and 0.41.
- splinepy: `Bezier(degrees=[4, 4, 4]).evaluate(queries, nthreads=2)`; its queries are box coordinates, made outside
  the timed part; ours are world points.
- PyGeM: `FFD([5, 5, 5])` at the same box coordinates. It is on no package index (there `pygem` is about glaciers):
  `pip install git+https://github.com/mathLab/PyGeM` first, or its comparison is skipped.
- scipy: `cKDTree(points).query(points)`, one worker.
- Spherical harmonics: radius about the centroid, real harmonics, plain least squares; 3 parameters for the centre.
- Decimated meshes: the Poisson mesh's largest part, `fast_simplification.simplify` to a number of faces; 3 parameters a
  vertex, the faces not counted.
"""


def load(name: str, hint: str = "pip install 'quadriform[bench]'") -> ModuleType:
    """Import a baseline.

    Raises:
        Missing: it is not installed.
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise Missing(f"{name} cannot be imported ({error}); {hint}") from error


@cache
def open3d() -> ModuleType:
    """Open3D; its wheel leaves libusb to the system, so that of `libusb-package` is loaded first."""
    ctypes.CDLL(str(load("libusb_package").get_library_path()), mode=ctypes.RTLD_GLOBAL)
    return load("open3d")


def poisson(points: np.ndarray, depth: int = DEPTH) -> Surface:
    """Screened Poisson reconstruction, normals estimated."""
    o3 = open3d()
    cloud = o3.geometry.PointCloud(o3.utility.Vector3dVector(points))
    cloud.estimate_normals(o3.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    cloud.orient_normals_consistent_tangent_plane(15)
    mesh, _ = o3.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth)
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


def pycpd(points: np.ndarray) -> Surface:
    """Non-rigid coherent point drift of an ellipsoid, in NumPy."""
    register = load("pycpd").DeformableRegistration

    def drift(target: np.ndarray, source: np.ndarray) -> np.ndarray:
        options = {"alpha": PYCPD_HOLD, "beta": CPD_WIDTH, "max_iterations": CPD_STEPS, "tolerance": 1e-4}
        return register(X=target, Y=source, **options).register()[0]

    return _drifted(points, drift)


def probreg(points: np.ndarray) -> Surface:
    """The same with fast Gauss transforms."""
    open3d()
    cpd = load("probreg.cpd")

    def drift(target: np.ndarray, source: np.ndarray) -> np.ndarray:
        options = {"w": 0.0, "maxiter": CPD_STEPS, "tol": 1e-4, "beta": CPD_WIDTH, "lmd": PROBREG_HOLD}
        return cpd.registration_cpd(source, target, "nonrigid", **options).transformation.transform(source)

    return _drifted(points, drift)


def _drifted(points: np.ndarray, drift: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> Surface:
    """An ellipsoid of the cloud's second moments, drifted onto it; lengths in RMS radii meanwhile."""
    centre = points.mean(axis=0)
    scale = np.sqrt(((points - centre) ** 2).sum(axis=1).mean())
    target = (points - centre) / scale
    squares, axes = np.linalg.eigh(target.T @ target / len(target))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    sphere = trimesh.creation.icosphere(subdivisions=3)
    source = (np.array(sphere.vertices) * np.sqrt(3 * squares)) @ axes.T
    return drift(target, source) * scale + centre, np.array(sphere.faces)


def splinepy(control_points: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Evaluation of a Bezier volume (l+1, m+1, n+1, 3) at box coordinates (n, 3), two threads."""
    degrees = [count - 1 for count in control_points.shape[:3]]
    rows = control_points.transpose(2, 1, 0, 3).reshape(-1, 3)  # its first index runs fastest
    volume = load("splinepy").Bezier(degrees=degrees, control_points=rows)
    return lambda queries: volume.evaluate(queries, nthreads=2)


def pygem(control_points: np.ndarray, rest: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The same by PyGeM's FFD; control points (l+1, m+1, n+1, 3), and where they rested, in box coordinates."""
    hint = "`pip install git+https://github.com/mathLab/PyGeM`; the package `pygem` of the index is about glaciers"
    module = load("pygem", hint)
    if not hasattr(module, "FFD"):
        raise Missing(f"the installed pygem is another package; {hint}")
    deformation = module.FFD(list(control_points.shape[:3]))
    moved = control_points - rest
    deformation.array_mu_x, deformation.array_mu_y, deformation.array_mu_z = (moved[..., k] for k in range(3))
    return deformation


def decimated(surface: Surface, faces: int) -> Surface:
    """The largest part of a mesh with about so many faces."""
    parts = trimesh.Trimesh(*surface, process=False).split(only_watertight=False)
    largest = max(parts, key=lambda part: len(part.faces))
    vertices, kept = np.asarray(largest.vertices), np.asarray(largest.faces)
    return load("fast_simplification").simplify(vertices, kept, target_count=faces)


def harmonics(points: np.ndarray, degree: int, directions: np.ndarray) -> np.ndarray:
    """A star-shaped surface: the radius about the centroid in real spherical harmonics, at unit directions (n, 3)."""
    centre = points.mean(axis=0)
    radius = np.linalg.norm(points - centre, axis=1)
    found = np.linalg.lstsq(_basis((points - centre) / radius[:, None], degree), radius)[0]
    return centre + directions * (_basis(directions, degree) @ found)[:, None]


def _basis(directions: np.ndarray, degree: int) -> np.ndarray:
    """Real spherical harmonics up to a degree at unit directions, (n, (degree + 1)^2)."""
    from scipy.special import sph_harm_y

    theta = np.arccos(np.clip(directions[:, 2], -1, 1))
    phi = np.arctan2(directions[:, 1], directions[:, 0])
    columns = []
    for l in range(degree + 1):
        for m in range(l + 1):
            value = sph_harm_y(l, m, theta, phi)
            columns += [value.real] if m == 0 else [value.real, value.imag]
    return np.stack(columns, axis=1)
