"""The models of controllers against the controllers themselves, or what stands for them."""
