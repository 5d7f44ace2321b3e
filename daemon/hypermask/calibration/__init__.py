"""From the camera's picture to the projector's: the paper's four points, and click the LEDs.

planar: one map between the images, right near one distance. procam: the projector's full matrix
from clicks at several distances. session: the operator's way through either. quality: the
expected error in millimetres. storage: every calibration is kept.
"""
