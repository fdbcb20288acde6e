"""What `rhs new KIND NAME` copies: for each kind a part that works and keeps its contract, whose class is called Skeleton.

They are read as text and never imported by the program; they may use what any stranger's plugin may."""
