"""The mask's geometry, under the show's own name, so that computing packages import no driver."""

from hypermask_drivers.mask import LED_NAMES, Mask, load_mask, load_mask_settings

__all__ = ["LED_NAMES", "Mask", "load_mask", "load_mask_settings"]
