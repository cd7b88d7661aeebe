"""Features that media need from pictures: lines and smooth areas; also random fields of unlimited resolution."""
