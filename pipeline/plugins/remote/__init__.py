"""Remote stores: files shared by many roots, in a bucket or on a file share."""

from flowsculpt.api import Command, Plugin

PLUGIN = Plugin(
    name="remote",
    version="1",
    commands={
        "push": Command(
            "flowsculpt.pipeline.plugins.remote.push_command:push",
            "Upload stored files that the remote store lacks.",
            "Maintain",
        )
    },
    remote_stores="flowsculpt.pipeline.plugins.remote.remote_files:RemoteFileStores",
)
