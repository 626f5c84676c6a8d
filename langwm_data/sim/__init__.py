"""The only room that knows a physics engine or a graphics library."""
