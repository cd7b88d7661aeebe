"""What media see in a picture: lines, smooth areas; and random fields that have no pixels."""
