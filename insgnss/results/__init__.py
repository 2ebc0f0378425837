"""How a result reaches the disk and the screen: tables as files, whole saves, short forms, an empty figure."""
