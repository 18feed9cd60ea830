"""In step 7: a photograph behind the vehicle, its camera found, and the camouflage in the photograph's own light."""
