"""Shafts: what is planned of them beyond a plane, on the plate of `waam_process.unrolled`."""
