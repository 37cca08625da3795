"""PI gains: their forms, the loop they close, and the specification that chooses them."""
