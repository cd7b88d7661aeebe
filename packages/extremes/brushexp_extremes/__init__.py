"""How far numbers can be trusted: extreme scenes, and a verdict on what each piece of the program makes of them."""
