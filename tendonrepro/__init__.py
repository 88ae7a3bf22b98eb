"""Reproduce Yan et al., Actuators 2026, 15(5), 271: tendon decoupling and alpha-TDE-NTSM control."""

from __future__ import annotations

__version__ = "0.1.0"
