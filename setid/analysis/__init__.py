"""Questions beyond one identification: fits, structures, noise bounds, streams of samples."""
