"""The command ``ssc_config``: configuration images, the menus that give and take them."""
