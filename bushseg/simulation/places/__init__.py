"""Places: what the ground is like, what people built on it and what grows there.

A layout draws a place's ways, works the ground and sets up what people built (`garden`, `farmland`,
`woods` and so on); what grows or stands about is then spread by the place's densities (`furnish`).
"""
