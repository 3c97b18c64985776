"""P_D over an area: cells of a map, rays from a radar, and export of a map."""
