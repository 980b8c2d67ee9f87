"""Studies that anyone can repeat: accuracy against time, the paper's figures and claims."""
