"""The review page: the pictures of shots side by side, frame by frame, and notes on them."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="review",
    version="1",
    commands={
        "review": Command(
            "pipeline.plugins.review.review_commands:review",
            "Write a page for reviewing shots frame by frame and writing notes.",
            "Look",
        ),
        "notes": Command(
            "pipeline.plugins.review.review_commands:notes",
            "List the notes that reviewers wrote about a shot.",
            "Look",
        ),
    },
    schemas={"notes": "pipeline.plugins.review.review_notes:NotesDocument"},
    notes="pipeline.plugins.review.review_notes:notes_file",
)
