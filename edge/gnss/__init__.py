"""The RTK receiver of a camera box: bytes in, a Fix with an honest sigma out, or the reason why there is none.

framing -> nmea, ubx -> epoch -> gates -> averaging, strung together by session (pure); port and receiver do the rest.
"""
