"""What Gymnasium calls when it looks for environments of other packages."""

ID = "calib/Model-v0"


def register() -> None:
    """Make ``gymnasium.make("calib/Model-v0", path=…)`` known."""
    import gymnasium

    if ID in gymnasium.registry:
        return
    gymnasium.register(
        ID,
        entry_point="calib_rl.gym:of_path",
        vector_entry_point="calib_rl.gym:vector_of_path",
    )
