"""Remote stores: files shared by many roots, in a bucket or on a file share."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="remote",
    version="1",
    commands={
        "push": Command(
            "pipeline.plugins.remote.push_command:push",
            "Upload stored files that the remote store lacks.",
            "Maintain",
        )
    },
    remote_stores="pipeline.plugins.remote.remote_files:STORES",
)
