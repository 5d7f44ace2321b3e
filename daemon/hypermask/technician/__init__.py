"""What a technician over SSH sees and does: state, checks, devices, journal, bundle."""
