"""Hard cases of rasterizer, renderer, environment, losses and optimizer: tests and `rauca bench stability` try them."""
