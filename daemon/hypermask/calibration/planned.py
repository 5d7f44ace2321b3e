"""Which positions a method needs, before the first click."""

from __future__ import annotations

from hypermask.calibration.outcome import Cart, Method
from hypermask.calibration.positions import Position, central_first, plan, position_at
from hypermask.calibration.quality import working_volume


def method_is_planar(method: Method) -> bool:
    return method != "click"


def planned_positions(
    cart: Cart, method: Method, poses_per_distance: int = 2, distance_m: float | None = None
) -> list[Position]:
    """Click: the best spread positions at the cart's distances. Planar: one, facing, in the
    middle of the picture at `distance_m` (default: the middle working distance)."""
    if method == "click":
        volume = working_volume(cart.mask, cart.camera, cart.nominal).weight(cart.nominal)
        positions = plan(
            cart.mask.leds,
            cart.camera,
            cart.nominal,
            volume,
            cart.distances_m,
            poses_per_distance,
            cart.prior,
        )
        return central_first(positions, cart.nominal)
    width, height = cart.nominal.projector.size
    distances = sorted(cart.distances_m)
    distance = distance_m if distance_m is not None else distances[len(distances) // 2]
    return [position_at(cart.nominal, (width / 2, height / 2), distance)]
