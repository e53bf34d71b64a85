"""The options of `quadriform track`."""

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from quadriform.cli.method_options import parse_noise, parse_prior
from quadriform.cli.options import decimals
from quadriform.errors import OptionError
from quadriform.words import numbers

if TYPE_CHECKING:
    from quadriform.imaging.ventricle_files import LabelledHeart


@dataclass(frozen=True)
class FrameReading:
    """How the frames are read.

    Attributes:
        surface: NAME=label:VALUES of the label images, such as epi=label:1+2; give it once for each surface.
        heart: The left ventricle in label images: endo=label:1 for the cavity, for the wall epi=label:1+2. In each
            frame it ends where its labels end flat, and volumes end there.
    """

    surface: list[str] | None = None
    heart: list[str] | None = None
    columns: str | None = None
    affine: str | None = None

    @property
    def labelled_heart(self) -> "LabelledHeart | None":
        """Which labels are the parts of a ventricle; None where --heart is not given.

        Raises:
            OptionError: an option that cannot be read, or that does not go with it.
        """
        from quadriform.imaging.ventricle_files import labelled_heart

        if self.heart is None:
            return None
        for option, given in (("--surface", self.surface), ("--columns", self.columns)):
            if given:
                raise OptionError(f"options --heart and {option} exclude each other; give one")
        return labelled_heart(self.heart)


@dataclass(frozen=True)
class Motion:
    """How the moving model is fitted.

    Attributes:
        strategy: cycle (all times at once), previous (from frame to frame), or alone.
        times: Times of the frames between commas. [default: 0, 1, 2 ...]
        period: After which the motion repeats: a time, auto (the frames are one cycle), or none.
        shift_slices: Estimate a rigid motion of each slice of contours, or a shift of each slice of an image stack in
            its plane, the same in all frames. Of images the points between two slices are left out.
        box: Control points along each axis, as 5,5,5.
        strength: Regularisation weight in space per data point. [default: auto]
        noise: Standard deviation of the points, in their unit, in place of that of images.
        prior: Prior of shape, .npz, as written by quadriform prior, of the shapes of all phases: those of the frames
            are members of its population; in place of --box and --strength.
    """

    strategy: str = "cycle"
    times: str | None = None
    period: str = "auto"
    shift_slices: bool = False
    box: str | None = None
    strength: float | None = None
    noise: str | None = None
    prior: str | None = None

    def options(self) -> dict[str, Any]:
        """The arguments for `quadriform.track`, but for the slices.

        Raises:
            OptionError: an option that cannot be read.
        """
        given = {
            "times": None if self.times is None else decimals(self.times, "--times"),
            "box": None if self.box is None else numbers(self.box, 3, "--box"),
            "strength": self.strength,
            "noise": None if self.noise is None else parse_noise(self.noise),
            "prior": None if self.prior is None else parse_prior(self.prior),
        }
        given = {name: value for name, value in given.items() if value is not None}
        return {"strategy": self.strategy, "period": _period(self.period), **given}


def _period(text: str) -> float | str | None:
    if text in ("auto", "none"):
        return "auto" if text == "auto" else None
    # float would also read inf, nan and 1_0
    if not re.fullmatch(r"\d+(\.\d*)?([eE][+-]?\d+)?", text):
        raise OptionError(f"option --period={text!r}: expected a time above 0, auto or none")
    return float(text)
