"""Stage one of LanGWM: scenes, rendering, labels, captions and sharded datasets. No torch here."""
