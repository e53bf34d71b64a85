"""A large noisy cloud fitted in 1 GiB of addresses, libraries included: python little_room.py COUNT (`make large`).

Prints the status, how many residuals there are, the noise, and the RMS distance of the surface to the true one in units
of the noise; exits with 1 where one of them is wrong, or no progress was told. COUNT points know the surface
about sqrt(COUNT / 30,000) times better than the sample that the fit begins with, which leaves a twentieth of the noise.
"""

import resource
import sys

import numpy as np

import quadriform as qf

NOISE, PART = 0.05, 100_000
WORST = 1 / 30
"""Of the noise: more than 60,000 points should leave, less than their sample does."""


def cloud(truth: qf.Superquadric, count: int) -> np.ndarray:
    """Points (count, 3), made a part at a time: there is no room for more."""
    rng, points = np.random.default_rng(0), np.empty((count, 3))
    for start in range(0, count, PART):
        part = points[start : start + PART]
        part[:] = truth.surface(rng.normal(size=part.shape)) + rng.normal(0, NOISE, part.shape)
    return points


def main() -> int:
    resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))
    truth, told = qf.Superquadric(semi_axes=(3, 2, 4)), []
    points = cloud(truth, int(sys.argv[1]))
    fit = qf.fit(points, box=(3, 3, 3), progress=lambda done, total: told.append(done))
    off = np.sqrt((fit.model.distance(truth.grid(16)[0]) ** 2).mean()) / NOISE
    print(fit.status, len(fit.residuals), f"noise {fit.noise:.4f}", f"off {off:.4f} of the noise")
    good = fit.status == "ok" and len(fit.residuals) == len(points) and told
    return 0 if good and abs(fit.noise / NOISE - 1) < 0.02 and off < WORST else 1


if __name__ == "__main__":
    sys.exit(main())
