"""Several paintings of a picture -> its brushwork with intervals, and whether these hold."""
