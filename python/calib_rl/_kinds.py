"""Kinds of models that agents act in."""

from __future__ import annotations

from typing import Literal

ModelKind = Literal["neighbors", "increments", "network"]
