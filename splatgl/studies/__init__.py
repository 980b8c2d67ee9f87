"""Studies that anyone can repeat: accuracy against time, stress, the paper's figures and claims."""
