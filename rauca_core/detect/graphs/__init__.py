"""Networks that come as graphs of other frameworks, as differentiable PyTorch and without those frameworks."""
