"""`splatgl figure`: the paper's figures and claims."""
