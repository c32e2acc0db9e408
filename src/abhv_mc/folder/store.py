"""A folder at any address that pyarrow.fs knows (s3://, gs://, hdfs://, file://): its objects, whole."""

import contextlib
from typing import Any

import pyarrow as pa
from pyarrow import fs as pyarrow_fs

from abhv_mc.io.address import Address
from abhv_mc.io.input_error import InputError

_PATIENCE = 20.0  # s for a store of Google's to answer
_OBJECT_STORES = ("s3", "gcs", "abfs")


class Store:
    """The objects below a folder. All methods raise OSError or pyarrow's errors where the store does not answer."""

    def __init__(self, address: Address, system: Any, base: str) -> None:
        self.address, self.system, self.base = address, system, base

    def below(self, name: str) -> "Store":
        """A folder in this one."""
        return Store(self.address, self.system, f"{self.base}/{name}".rstrip("/"))

    def find(self) -> list[Any]:
        """What pyarrow says of all objects, those of folders below among them."""
        selector = pyarrow_fs.FileSelector(self.base, allow_not_found=True, recursive=True)
        found: list[Any] = self.system.get_file_info(selector)
        return found

    def read(self, name: str) -> bytes:
        """An object's content. Raises FileNotFoundError."""
        with self.system.open_input_stream(f"{self.base}/{name}") as stream:
            return bytes(stream.read())

    def write(self, name: str, content: bytes) -> None:
        """Put an object, in place of another one of its name."""
        place = f"{self.base}/{name}"
        if self.system.type_name not in _OBJECT_STORES:
            self.system.create_dir(place.rpartition("/")[0], recursive=True)
        with self.system.open_output_stream(place) as stream:
            stream.write(content)

    def delete(self, name: str) -> None:
        """Delete an object, where there is one."""
        with contextlib.suppress(FileNotFoundError):
            self.system.delete_file(f"{self.base}/{name}")

    def ages(self, *names: str) -> list[Any]:
        """When each object was written, by the store's clock; None for one that there is not."""
        return [info.mtime for info in self.system.get_file_info([f"{self.base}/{name}" for name in names])]


def open_store(address: Address) -> Store:
    """The folder at an address. Raises InputError for what is none."""
    uri = address.uri()
    if uri.startswith(("gs:", "gcs:")) and "retry_limit_seconds=" not in uri:
        uri += f"{'&' if '?' in uri else '?'}retry_limit_seconds={_PATIENCE:g}"  # 900 s in the library
    try:
        system, base = pyarrow_fs.FileSystem.from_uri(uri)
    except (pa.ArrowException, OSError, ValueError) as error:
        found = f"'{address}' ({address.explain(error)})"
        raise InputError("address", found, "s3://bucket/folder, gs://bucket/folder or a path") from None
    return Store(address, system, base.rstrip("/"))
