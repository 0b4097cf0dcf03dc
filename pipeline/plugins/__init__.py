"""The plug-ins that come with flowsculpt. They use what any plug-in may use, and none imports another."""
