"""Scans of patients: read from files, their geometry checked, resampled where it has to be."""
