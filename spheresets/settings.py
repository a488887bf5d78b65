"""What can be asked of a fit: one frozen object, the same for the command, the cache and the scene file."""

from dataclasses import dataclass

from coslobe.core.errors import UsageError

# Where spheres may reach, by method; the first is what the method was made for.
MODES = {
    "balanced": ("balanced", "inner", "outer"),
    "variational": ("outer",),
    "medial": ("outer", "inner"),
}
QUALITIES = ("fast", "best")


@dataclass(frozen=True)
class FitSettings:
    """How a sphere tree is to be fitted.

    Attributes
    ----------
    count : int
        Spheres in the finest level.
    method : str
        A key of MODES.
    quality : str
        One of QUALITIES.
    mode : str
        balanced: as much outside as uncovered; inner: no sphere reaches outside; outer: all of the surface
        is covered. Empty: what the method was made for.
    seed : int
        The same seed gives the same spheres on the same device.
    levels : int or None
        Levels of detail to keep, the finest included; None: all.

    Raises
    ------
    UsageError
        Such a fit cannot be asked for.
    """

    count: int = 64
    method: str = "balanced"
    quality: str = "fast"
    mode: str = ""
    seed: int = 0
    levels: int | None = None

    def __post_init__(self) -> None:
        _check_choice("method", self.method, tuple(MODES))
        _check_choice("quality", self.quality, QUALITIES)
        if not self.mode:
            object.__setattr__(self, "mode", MODES[self.method][0])
        _check_choice("mode", self.mode, MODES[self.method], f" with method {self.method}")
        if self.count < 1:
            raise UsageError(f"count must be >= 1 (got {self.count})", "ask for at least one sphere")
        if self.seed < 0:
            raise UsageError(f"seed must be >= 0 (got {self.seed})")
        if self.levels is not None and self.levels < 1:
            raise UsageError(f"levels must be >= 1 (got {self.levels})", "1 keeps only the finest level")


def _check_choice(name: str, value: str, known: tuple[str, ...], where: str = "") -> None:
    if value not in known:
        raise UsageError(f"no {name} {value!r}{where}", f"{name} can be {' or '.join(known)}")
