"""The public names; `quadriform` imports each from here when it is first used."""

from . import examples as examples
from .files import load as load
from .files import read_points as read_points
from .files import save as save
from .files.guide_points import read_guide_point_frames as read_guide_point_frames
from .files.guide_points import read_guide_points as read_guide_points
from .files.slice_planes import read_slice_planes as read_slice_planes
from .fitting.fit import refine as refine
from .fitting.result import Fit as Fit
from .fitting.result import SuperquadricFit as SuperquadricFit
from .fitting.superquadric.fit import fit_superquadric as fit_superquadric
from .heart.measure import measure as measure
from .heart.measures_table import Measures as Measures
from .heart.measures_table import write_measures as write_measures
from .imaging.fit_files import fit as fit
from .imaging.image_points import points_from_image as points_from_image
from .imaging.object_choice import Labels as Labels
from .imaging.object_choice import Percentile as Percentile
from .imaging.reading import read_volume as read_volume
from .imaging.segmentation import segment as segment
from .imaging.ventricle import ventricle_from_labels as ventricle_from_labels
from .imaging.ventricle import ventricle_from_perfusion as ventricle_from_perfusion
from .imaging.volume import Volume as Volume
from .motion.slice_move import SliceMove as SliceMove
from .motion.track import Track as Track
from .motion.tracking import track as track
from .priors.learning import learn_prior as learn_prior
from .report.exchange import to_pyvista as to_pyvista
from .report.exchange import to_trimesh as to_trimesh
from .report.notebook import show as show
from .report.plot import plot as plot
from .shapes.comparison import dice as dice
from .shapes.comparison import surface_distances as surface_distances
from .shapes.control_box import ControlBox as ControlBox
from .shapes.mesh import Mesh as Mesh
from .shapes.model import DeformableModel as DeformableModel
from .shapes.moving_model import MovingModel as MovingModel
from .shapes.prior import PriorReport as PriorReport
from .shapes.prior import ShapePrior as ShapePrior
from .shapes.superquadric import Superquadric as Superquadric
from .shapes.wall import wall_mesh as wall_mesh

__version__: str
