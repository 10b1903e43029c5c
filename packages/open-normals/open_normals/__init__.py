"""Data alone: ``open-normals7.onnx``, its digest in ``weights.json``, and what it was made from."""
