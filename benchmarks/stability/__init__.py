"""Hard cases of rasteriser, renderer, environment, losses and optimiser: tests and `rauca bench stability` try them."""
