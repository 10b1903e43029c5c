"""The open normal networks as PyTorch modules, and their way into ONNX files and out of them."""
