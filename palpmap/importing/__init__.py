"""The door for foreign data: from a rig's own files to a scan and a study."""
