"""The only place that knows files, keys, degrees and decibels."""
