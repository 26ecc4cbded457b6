"""Weights from elsewhere: arrays, torch, equinox, jax-sysid and ONNX. Nothing executes on loading.

Files are read as numbers only (``weights_only`` of torch, ``allow_pickle=False`` of numpy, the
tensors of ONNX). Kinds of layers are recognised by their class names; an unknown one is refused by
its name. The models are those of the imported numbers: sums of two biases are rounded once.
"""
