"""What computes, free of wires, disks, clocks and threads."""
