"""``gt``: the scan itself as a reconstruction, the self-test of the ruler.

Its P2S distances and normal error must be 0, and its Chamfer distance the sampling floor.
"""

from harness.core.artifacts import Capture, Reconstruction
from harness.core.protocols import Context, MethodInfo, Privilege


class GroundTruth:
    """Hands the true surface back."""

    info = MethodInfo(
        name="gt",
        title="Ground truth",
        privileges=(Privilege.GROUND_TRUTH_MESH,),
    )

    def reconstruct(self, capture: Capture, context: Context) -> Reconstruction:  # noqa: ARG002
        """The scan's own mesh, lent by the pipeline under a declared privilege."""
        with context.stage("copy"):
            return Reconstruction(mesh=context.privileged[Privilege.GROUND_TRUTH_MESH])


gt = GroundTruth()
