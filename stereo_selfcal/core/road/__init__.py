"""Models of the road: stripes, cells of the surface, the surface's unevenness, and priors of roads."""
