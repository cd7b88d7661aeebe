"""Code that relies on private parts of other libraries; most modules state the tested versions."""
