"""Code that uses private parts of other libraries; each module names the version that it was tried with."""
