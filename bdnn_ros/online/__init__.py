"""Live identification: the stream of joint states, the trainer process, and the models it hands over."""
