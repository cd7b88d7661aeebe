"""Feature networks whose weights the user has, and LPIPS, as a loss and as a metric, which looks through them."""
