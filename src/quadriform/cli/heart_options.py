"""Options of `quadriform fit` by which the ventricle of an image is fitted, and how they are read."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quadriform.errors import OptionError

if TYPE_CHECKING:
    from quadriform.imaging.file_points import ReadOptions
    from quadriform.imaging.ventricle_files import Heart


@dataclass(frozen=True)
class HeartChoice:
    """How the left ventricle is found in an image.

    Hearts:
        heart: Label image of a left ventricle: endo=label:1 for the cavity, or endo=label:SEGMENT, endo=preset:acdc;
            for the wall epi=label:1+2 likewise. There are no points where the image cuts the ventricle, and volumes
            end at that face, or at --base x,y,z/nx,ny,nz.
        perfusion: Perfusion image: the bright wall of a left ventricle that is open at its base, and the cavity in it.
    """

    heart: list[str] | None = None
    perfusion: bool = False

    def parse(
        self, inputs: Sequence[Path], surfaces: Sequence[str], options: "ReadOptions", base: Any
    ) -> "Heart | None":
        """How the ventricle is found; None where neither option is given.

        Raises:
            OptionError: an option that cannot be read, or that goes with no heart.
        """
        given = [name for name, value in (("--heart", self.heart), ("--perfusion", self.perfusion)) if value]
        if not given:
            return None
        from quadriform.imaging.ventricle_files import PerfusionHeart, check_image_options, labelled_heart

        if len(given) > 1 or surfaces:
            raise OptionError(f"options {given[0]} and {[*given, '--surface'][1]} exclude each other; give one")
        if not inputs:
            raise OptionError(f"option {given[0]}: expected at least one INPUT image")
        heart = labelled_heart(self.heart) if self.heart else PerfusionHeart()
        check_image_options(heart, options)
        if base is not None and not isinstance(base, tuple):
            raise OptionError(f"option --base: with {given[0]} expected a plane x,y,z/nx,ny,nz, found a file")
        return heart
