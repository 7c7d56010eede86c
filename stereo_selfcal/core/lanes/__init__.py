"""Lane lines in the images: found, measured, matched between the cameras."""
