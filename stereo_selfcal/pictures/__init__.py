"""Pictures for people, and the canvas they are drawn on."""
