"""Scenes for cornerbench: recipes in TOML become rendered radiance with exact truth."""
