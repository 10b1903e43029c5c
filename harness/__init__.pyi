"""What ``import harness`` offers, a line for each name; ``__init__.py`` reads it, too."""

from harness.core.artifacts import Body as Body
from harness.core.artifacts import Capture as Capture
from harness.core.artifacts import NormalMaps as NormalMaps
from harness.core.artifacts import Reconstruction as Reconstruction
from harness.core.camera import Camera as Camera
from harness.core.camera_frames import BLENDER_TO_WORLD as BLENDER_TO_WORLD
from harness.core.camera_frames import quaternion_from_rotation as quaternion_from_rotation
from harness.core.camera_frames import write_colmap as write_colmap
from harness.core.camera_frames import write_transforms_json as write_transforms_json
from harness.core.errors import DataError as DataError
from harness.core.errors import HarnessError as HarnessError
from harness.core.errors import MethodError as MethodError
from harness.core.errors import MissingPart as MissingPart
from harness.core.errors import ProtocolMismatch as ProtocolMismatch
from harness.core.mesh import Mesh as Mesh
from harness.core.protocols import Configurable as Configurable
from harness.core.protocols import Context as Context
from harness.core.protocols import Deviation as Deviation
from harness.core.protocols import Method as Method
from harness.core.protocols import MethodInfo as MethodInfo
from harness.core.protocols import Part as Part
from harness.core.protocols import Privilege as Privilege
from harness.core.records import MetricValue as MetricValue
from harness.core.results import DepthMaps as DepthMaps
from harness.core.results import Gaussians as Gaussians
from harness.core.results import PhotoFrame as PhotoFrame
from harness.core.results import PointCloud as PointCloud
from harness.core.results import ViewDepth as ViewDepth
from harness.core.rigs import RingRig as RingRig
from harness.core.rigs import camera_yaw_deg as camera_yaw_deg
from harness.core.settings import MetricProtocol as MetricProtocol
from harness.data.camera_files import read_cameras as read_cameras
from harness.data.manifest import Manifest as Manifest
from harness.data.manifest import load_manifest as load_manifest
from harness.files.mesh_files import load_mesh as load_mesh
from harness.files.mesh_files import save_mesh as save_mesh
from harness.geometry.images import load_mask as load_mask
from harness.geometry.images import load_rgba as load_rgba
from harness.run.external_meshes import PairScores as PairScores
from harness.run.external_meshes import score as score
from harness.run.frames import evaluate as evaluate
from harness.run.frames import read_run as read_run
from metrics.score import Score as Score

__version__: str
OFFERED: dict[str, str]
