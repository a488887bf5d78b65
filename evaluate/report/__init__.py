"""Reports of evaluations: one HTML page each, which opens without a network and holds its pictures."""

from coslobe.evaluate.report.scene import write_report

__all__ = ["write_report"]
