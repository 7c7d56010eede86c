"""Models of the road: stripes, cells, surface, and what is known of roads beforehand."""
