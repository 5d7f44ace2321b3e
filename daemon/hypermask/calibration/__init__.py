"""From the camera's picture to the projector's: the paper's four points, and click the LEDs.

planar: one map between the images, right near one distance. procam: the projector's full matrix
from clicks at several distances. session: the operator's way through either. quality: the
expected error in millimetres. storage: every calibration is kept.
"""

from hypermask.calibration.outcome import METHODS, Cart, Method, Outcome, conclude
from hypermask.calibration.parameters import ProCam, ProjectorPrior, nominal_procam
from hypermask.calibration.placements import Placement
from hypermask.calibration.planar import Planar
from hypermask.calibration.positions import Position
from hypermask.calibration.procam import Solution, solve
from hypermask.calibration.quality import Quality, assess, working_volume
from hypermask.calibration.reference import solve_opencv
from hypermask.calibration.rehearsed import Rehearsed, rehearse
from hypermask.calibration.session import Phase, Session, View, planned_positions
from hypermask.calibration.still import Sighting

__all__ = [
    "METHODS",
    "Cart",
    "Method",
    "Outcome",
    "Phase",
    "Placement",
    "Planar",
    "Position",
    "ProCam",
    "ProjectorPrior",
    "Quality",
    "Rehearsed",
    "Session",
    "Sighting",
    "Solution",
    "View",
    "assess",
    "conclude",
    "nominal_procam",
    "planned_positions",
    "rehearse",
    "solve",
    "solve_opencv",
    "working_volume",
]
