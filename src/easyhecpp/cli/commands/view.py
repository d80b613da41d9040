"""``easyhecpp view``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from easyhecpp.cli.output import say


@dataclass(frozen=True)
class View:
    """Show the arm, the camera and its uncertainty in 3-D, in a browser."""

    capture: Positional[Path]
    """Folder of the capture."""

    result: Positional[Path]
    """The result.json whose pose is shown."""

    host: str = "127.0.0.1"
    """Address to listen at; 0.0.0.0 lets other machines look too."""

    port: int = 8080
    """Port to listen at."""

    browser: bool = False
    """Open the page in the default browser."""

    def run(self, command_line: str) -> int:
        """Serve the page until interrupted."""
        from easyhecpp.capture import Capture
        from easyhecpp.formats.result_file import ResultFile
        from easyhecpp.report.viewer import PoseViewer
        from easyhecpp.session.refinement import as_refined

        result = ResultFile.read(self.result)
        capture = as_refined(Capture.load(self.capture), result)
        viewer = PoseViewer(result, capture, host=self.host, port=self.port)
        try:
            if self.browser:
                viewer.open_browser()
            say(f"Open {viewer.url} in a browser. Press Ctrl+C to end.")
            viewer.wait()
        except KeyboardInterrupt:
            pass  # how a viewer is meant to end
        finally:
            viewer.stop()
        return 0
