using System;
using System.Collections.Concurrent;
using System.IO;
using System.Net.WebSockets;
using System.Text;
using System.Threading;
using System.Threading.Tasks;

namespace Tensionlab
{
    /// <summary>
    /// Connection to a bridge, which looks for it again where it goes away. It works in the background; call
    /// TrySend and TryReceive from one thread, such as Unity's, in each picture.
    /// </summary>
    public sealed class BridgeConnection : IDisposable
    {
        readonly Uri url;
        readonly TimeSpan retry;
        readonly CancellationTokenSource over = new CancellationTokenSource();
        readonly ConcurrentQueue<object> received = new ConcurrentQueue<object>();
        volatile ClientWebSocket socket;
        volatile bool waiting;

        /// <param name="url">Such as ws://127.0.0.1:8765/command.</param>
        /// <param name="retrySeconds">Between attempts to connect.</param>
        public BridgeConnection(string url, double retrySeconds)
        {
            this.url = new Uri(url);
            retry = TimeSpan.FromSeconds(retrySeconds);
            Task.Run(Work);
        }

        /// <summary>Next of what came: a Message, or a Lost.</summary>
        public bool TryReceive(out object what)
        {
            return received.TryDequeue(out what);
        }

        /// <summary>Send a frame; false, and nothing is sent, while the answer to the last one is on its way.</summary>
        public bool TrySend(string frame)
        {
            ClientWebSocket open = socket;
            if (open == null || waiting) return false;
            waiting = true;
            Send(open, frame);
            return true;
        }

        /// <summary>End the run: all modules release their cables.</summary>
        public void Stop()
        {
            ClientWebSocket open = socket;
            if (open != null) Send(open, "{\"type\":\"stop\"}");
        }

        public void Dispose()
        {
            over.Cancel();
        }

        async void Send(ClientWebSocket open, string text)
        {
            try
            {
                var content = new ArraySegment<byte>(Encoding.UTF8.GetBytes(text));
                await open.SendAsync(content, WebSocketMessageType.Text, true, over.Token).ConfigureAwait(false);
            }
            catch (Exception)
            {
                // Who receives learns of it as well, and says so.
            }
        }

        async Task Work()
        {
            bool told = false;
            while (!over.IsCancellationRequested)
            {
                using (var open = new ClientWebSocket())
                {
                    try
                    {
                        await open.ConnectAsync(url, over.Token).ConfigureAwait(false);
                        waiting = false;
                        while (true)
                        {
                            Message message = Message.Read(await Receive(open).ConfigureAwait(false));
                            received.Enqueue(message);
                            if (message is Welcome) socket = open;
                            if (message is State || message is Refused) waiting = false;
                            told = false;
                        }
                    }
                    catch (Exception error)
                    {
                        bool first = socket != null || !told;
                        socket = null;
                        told = true;
                        if (first && !over.IsCancellationRequested) received.Enqueue(new Lost(url, error.Message));
                    }
                }
                try
                {
                    await Task.Delay(retry, over.Token).ConfigureAwait(false);
                }
                catch (OperationCanceledException)
                {
                    return;
                }
            }
        }

        async Task<string> Receive(ClientWebSocket open)
        {
            var part = new ArraySegment<byte>(new byte[16384]);
            using (var whole = new MemoryStream())
            {
                while (true)
                {
                    WebSocketReceiveResult got = await open.ReceiveAsync(part, over.Token).ConfigureAwait(false);
                    if (got.MessageType == WebSocketMessageType.Close)
                        throw new IOException(got.CloseStatusDescription ?? "it closed the connection");
                    whole.Write(part.Array, 0, got.Count);
                    if (got.EndOfMessage) return Encoding.UTF8.GetString(whole.ToArray());
                }
            }
        }
    }

    /// <summary>The bridge cannot be reached, or has gone.</summary>
    public sealed class Lost
    {
        public readonly string Reason;

        public Lost(Uri url, string why)
        {
            Reason = "the bridge at " + url + " is not there (" + why + "); looking for it again";
        }
    }
}
