"""Rasters of pages, as the script of a page reads them."""

import base64


def unpacked(text):
    """Keys of spikes as the page's script reads them."""
    keys, key, gap, place = [], 0, 0, 1
    for byte in base64.b64decode(text):
        gap += (byte & 127) * place
        place *= 128
        if byte < 128:
            key += gap
            keys.append(key)
            gap, place = 0, 1
    return keys
