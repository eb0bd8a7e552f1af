"""A proxy before a service, which passes on what a browser sends with some of its text replaced."""

import asyncio
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


@contextmanager
def proxy(upstream: int, replaced: Mapping[bytes, bytes]) -> Iterator[int]:
    """Its port: it passes on to another one of this machine, for each text that it replaces what stands for it."""

    async def pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, texts: Mapping[bytes, bytes]) -> None:
        try:
            while part := await reader.read(1 << 16):
                for before, after in texts.items():
                    part = part.replace(before, after)
                writer.write(part)
                await writer.drain()
        except ConnectionError:
            pass
        finally:
            writer.close()

    async def visited(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        there, back = await asyncio.open_connection("127.0.0.1", upstream)
        await asyncio.gather(pass_on(reader, back, replaced), pass_on(there, writer, {}))

    async def end() -> None:
        server.close()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    loop = asyncio.new_event_loop()  # of a thread: Playwright has one in this
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    server = asyncio.run_coroutine_threadsafe(asyncio.start_server(visited, "127.0.0.1", 0), loop).result()
    try:
        yield server.sockets[0].getsockname()[1]
    finally:
        asyncio.run_coroutine_threadsafe(end(), loop).result()
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
