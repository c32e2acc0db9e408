"""Command ``explore``."""

from typing import Annotated

import typer

from abhv_mc.cli.options import Folder, TrustCode
from abhv_mc.cli.printing import announce_compiling, say
from abhv_mc.io.messages import InputError


def explore(
    folder: Folder,
    port: Annotated[
        int,
        typer.Option(
            min=0, max=65535, help="Port of the server on this machine.", show_default="a free one"
        ),
    ] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in a browser.")] = True,
    trust_code: TrustCode = False,
) -> None:
    """Show up to a million flights in the browser, to brush, filter and re-run them.

    The server accepts only connections from this machine, at an address with a token; Ctrl-C stops
    it. It reads only the Parquet files of the campaign; clicking on a flight re-runs it like
    `replay`.
    """
    import webbrowser
    from contextlib import suppress
    from pathlib import Path
    from tempfile import TemporaryDirectory

    from abhv_mc_explore.counts import open_flights
    from abhv_mc_explore.server import ExploreServer

    with open_flights(folder) as table:
        announce_compiling()
        try:
            server = ExploreServer(folder, table, port=port, trust_code=trust_code)
        except OSError as error:
            raise InputError(
                "--port", f"port {port} cannot be opened ({error.strerror})", "a free port"
            ) from None
        with server, TemporaryDirectory(prefix="abhv-mc-") as private:
            say(server.url, flush=True)
            if browser:
                # Other users can see the arguments of the browser, but cannot read this file.
                page = Path(private, "explore.html")
                page.write_text(f'<meta http-equiv="refresh" content="0; url={server.url}">')
                webbrowser.open(page.as_uri())
            with suppress(KeyboardInterrupt):  # Ctrl-C ends the server.
                server.serve_forever()
