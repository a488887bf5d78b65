"""What every lighting method offers to the renderer."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

from numpy.typing import NDArray

from coslobe.render.assets import Blockers
from coslobe.render.gbuffer import GBuffer
from coslobe.render.scene import Scene
from coslobe.render.visible import Visible


@dataclass(frozen=True)
class Shading:
    """Direct light at the points of a G-buffer.

    Attributes
    ----------
    radiance : float32 [n, 3]
        Outgoing radiance towards the viewer, linear Rec.709.
    kernel_seconds : float
        All kernels, by profiling events, without transfers.
    build_seconds : float
        Time spent on building programs for this frame; 0 where they were ready.
    skipped : dict
        What was not computed because the scene did not need it, by name.
    layers : dict
        The layers that were asked for, by name: [n] or [n, 3].
    """

    radiance: NDArray
    kernel_seconds: float
    build_seconds: float
    skipped: dict[str, Any] = field(default_factory=dict)
    layers: dict[str, NDArray] = field(default_factory=dict)


class Method(Protocol):
    """A lighting method; it keeps what does not change between frames."""

    def prepare(self, scene: Scene) -> None:
        """Get what no frame changes, such as tables, so that it does not count as the first frame's time."""
        ...

    def shade(
        self, scene: Scene, gbuffer: GBuffer | Visible, blockers: Blockers, layers: Sequence[str] = ()
    ) -> Shading:
        """Light the points of `gbuffer`; `layers` may name irradiance, products and mask_leaves.

        irradiance: diffuse light that arrives, float32 [n, 3]; products: lobe products computed, [n];
        mask_leaves: leaves of the visibility masks, [n].
        """
        ...
