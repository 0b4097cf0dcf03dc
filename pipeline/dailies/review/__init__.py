"""The review page: a static folder to look at shots frame by frame, beside each other, with measures."""
