"""The review page: one static folder to look at shots frame by frame, beside each other, with their measures."""
