"""Parametric bodies: Anny and SMPL-X behind one protocol."""
