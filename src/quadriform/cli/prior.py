"""`quadriform prior`: a prior of shape learned from the models of a cohort or of a folder, or from meshes."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from quadriform.cli.options import Common, subcommand
from quadriform.cli.screen import note, show
from quadriform.errors import UNRELIABLE, InputError, OptionError, WarningKind, Warnings
from quadriform.shapes.record import worst
from quadriform.words import after_number, first_of, numbers

if TYPE_CHECKING:
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.model import DeformableModel
    from quadriform.shapes.prior import ShapePrior


@dataclass(frozen=True)
class Member:
    """A model of the population with the status and the warnings of its fit, or its meshes by name, which have none."""

    model: "DeformableModel | dict[str, Mesh]"
    status: str = "unknown"
    warnings: Warnings = field(default_factory=dict)


@subcommand
def prior(
    results: Path,
    *,
    output: Path,
    box: str | None = None,
    modes: int | None = None,
    scale: bool = False,
    frame: int = 0,
    common: Common,
) -> None:
    """Learn a prior of shape from a population: its mean, its modes, and the freedom outside of them.

    Models that are unreliable are left out.

    Args:
        results: Folder of the results of a cohort, of model files, .json or .npz, or of meshes whose vertices
            correspond: one file for each member, or a folder for each with a file for each surface, such as endo.ply.
        output: The prior, .npz.
        box: Control points along each axis. [default: those of the first model, of meshes 5,5,5]
        modes: Number of modes. [default: those of 99.9 % of the variance]
        scale: Remove the sizes of the models too.
        frame: Which frame of moving models, from 0.
    """
    from quadriform.cli.status import check_strict
    from quadriform.files import save
    from quadriform.files.atomic import check_writable
    from quadriform.files.priors import PRIOR_SUFFIXES
    from quadriform.files.reading import named_in_errors, suffix_of
    from quadriform.priors.learning import learn_prior

    suffix_of(output, PRIOR_SUFFIXES, "a prior")
    check_writable(output, common.force)
    members, stated = _members(results, frame)
    for member in members:
        check_strict(common.strict, member.status, member.warnings, results)
    used = [member.model for member in members if member.status != UNRELIABLE]
    if left_out := len(members) - len(used):
        note(f"{left_out} of {len(members)} models are unreliable and were left out")
    with named_in_errors(results):
        learned = learn_prior(used, box=_box(box, used), modes=modes, scale=scale, **stated)
    save(learned, output, common.force)
    record = {"output": str(output), "left_out": left_out} | {"status": worst(*(each.status for each in members))}
    record |= _record(learned)
    show(record, common.as_json, _rows(learned, record), str(results))


def _box(text: str | None, models: Sequence["DeformableModel | dict[str, Mesh]"]) -> tuple[int, int, int]:
    if text is None and models and not isinstance(models[0], dict):
        along_s, along_t, along_u = models[0].box.control_points.shape[:3]
        return along_s, along_t, along_u
    along_s, along_t, along_u = numbers(text or "5,5,5", 3, "--box")
    return along_s, along_t, along_u


# --- the population ----------------------------------------------------------------------------------------------


def _members(results: Path, frame: int) -> tuple[list[Member], dict[str, str]]:
    """The members, and the frame and unit that meshes state; models have their own."""
    from quadriform.cli.prior_meshes import mesh_files, read_members, space_and_unit
    from quadriform.cohort.layout import NAME

    if not results.is_dir():
        raise InputError(f"{str(results)!r}: expected a folder of the results of a cohort, of model files or of meshes")
    if (results / NAME).exists():
        return _of_a_cohort(results, frame), {}
    if models := _of_files(results, frame):  # meshes beside models are their surfaces
        return models, {}
    files = mesh_files(results)
    if not files:
        raise InputError(
            f"{str(results)!r}: expected the results of a cohort, model files, .json or .npz, or meshes; found none"
        )
    return [Member(meshes) for meshes in read_members(files)], space_and_unit(files)


def _of_a_cohort(results: Path, frame: int) -> list[Member]:
    from quadriform.cohort.layout import read_layout
    from quadriform.cohort.overview import overview
    from quadriform.cohort.stores import models, require_library

    for library in ("zarr", "pyarrow"):
        require_library(library)
    layout = read_layout(results)
    subjects = {each.id: each for each in overview(results, layout.subjects).worst}
    found = []
    for name, model in models(results, layout, range(layout.subjects), frame):
        about = subjects.get(name)
        # kinds of a later version are not known here
        kinds = {WarningKind(k): text for k, text in about.warnings.items() if k in tuple(WarningKind)} if about else {}
        found.append(Member(model, about.status if about else "unknown", kinds))
    return found


def _of_files(folder: Path, frame: int) -> list[Member]:
    from quadriform.cli.results import MODEL
    from quadriform.files.models import MODEL_SUFFIXES, is_model_file, read_any_model
    from quadriform.files.priors import PRIOR_SUFFIXES, is_prior_file
    from quadriform.files.reading import visible_files

    # those of several inputs of `fit` are in folders of their own
    files = [file for file in visible_files(folder) if file.suffix.lower() in MODEL_SUFFIXES]
    files += sorted(folder.glob(f"*/{MODEL}"))
    priors = [file for file in files if file.suffix.lower() in PRIOR_SUFFIXES and is_prior_file(file)]
    # a .npz may contain points too
    models = [file for file in files if file not in priors and is_model_file(file)]
    every = [_state(read_any_model(file), frame, file) for file in models]
    return [Member(model, model.record.status, model.record.warnings) for model in every]


def _state(model: Any, frame: int, file: Path) -> "DeformableModel":
    """The model of a frame; a model that does not move has one."""
    from quadriform.shapes.model import DeformableModel

    times = [0.0] if isinstance(model, DeformableModel) else model.frame_times
    if not 0 <= frame < len(times):
        raise OptionError(f"option --frame={frame}: {str(file)!r} has {len(times)} frames, from 0")
    return model if isinstance(model, DeformableModel) else model.at(float(times[frame]))


# --- what is shown -----------------------------------------------------------------------------------------------


def _record(prior: "ShapePrior") -> dict[str, Any]:
    return {
        "models": prior.n_models,
        "surfaces": list(prior.surfaces),
        "control_points": list(prior.box.control_points.shape[:3]),
        "modes": len(prior.modes),
        "standard_deviations": prior.deviations.tolist(),
        **asdict(prior.report),
        "space": prior.space,
        "unit": prior.unit,
    }


def _rows(prior: "ShapePrior", record: dict[str, Any]) -> list[tuple[str, str]]:
    report, unit = prior.report, after_number(prior.unit)
    deviations = first_of([f"{value:.3g}" for value in prior.deviations], 5)
    return [
        ("models", str(prior.n_models)),
        ("surfaces", ", ".join(prior.surfaces)),
        ("modes", f"{len(prior.modes)}; standard deviations {deviations}{unit}"),
        ("modes for 90, 95, 99 %", f"{report.modes_90}, {report.modes_95}, {report.modes_99}"),
        ("leave-one-out error", f"{report.leave_one_out:.3g}{unit}"),
        ("specificity", f"{report.specificity:.3g}{unit}"),
        ("residual", f"{report.residual:.3g}{unit}"),
        ("written", record["output"]),
    ]
