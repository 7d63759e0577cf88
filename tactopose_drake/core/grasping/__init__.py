"""How a hand can hold an object: the reach of fingers, the choice of a grasp, and the law that closes it."""
