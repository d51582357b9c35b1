using System.Collections.Generic;
using System.Linq;

namespace Tensionlab
{
    /// <summary>Message of the bridge. Its axes are those of the rig; RigAxes turns them into Unity's.</summary>
    public abstract class Message
    {
        readonly Dictionary<string, object> members;

        protected Message(Dictionary<string, object> members)
        {
            this.members = members;
        }

        /// <summary>The message that a text holds; FormatException if it is none that a client gets.</summary>
        public static Message Read(string text)
        {
            var members = Json.Read(text) as Dictionary<string, object>;
            object type = null;
            if (members != null) members.TryGetValue("type", out type);
            switch (type as string)
            {
                case "welcome": return new Welcome(members);
                case "state": return new State(members);
                case "event": return new BridgeEvent(members);
                case "refused": return new Refused(members);
                default: throw new System.FormatException("no message of the bridge: " + text);
            }
        }

        protected string Text(string name)
        {
            return Get(name) as string;
        }

        protected double Number(string name)
        {
            object value = Get(name);
            return value is double ? (double)value : double.NaN;
        }

        protected double[] Numbers(string name)
        {
            return List(name).Select(each => each is double ? (double)each : double.NaN).ToArray();
        }

        protected string[] Texts(string name)
        {
            return List(name).Select(each => each as string).ToArray();
        }

        protected bool[] Flags(string name)
        {
            return List(name).Select(each => each is bool && (bool)each).ToArray();
        }

        /// <summary>A member that has no property of its own; null if it is left out.</summary>
        public object Get(string name)
        {
            object value;
            members.TryGetValue(name, out value);
            return value;
        }

        List<object> List(string name)
        {
            return Get(name) as List<object> ?? new List<object>();
        }
    }

    /// <summary>First message to every client: what rig there is.</summary>
    public sealed class Welcome : Message
    {
        internal Welcome(Dictionary<string, object> members) : base(members)
        {
        }

        public string Rig { get { return Text("rig"); } }

        /// <summary>Axis of the rig that points up, such as "y" or "-z"; null if the rig does not say.</summary>
        public string Up { get { return Text("up"); } }

        public string[] Modules { get { return Texts("modules"); } }

        /// <summary>Maximum tensions in N.</summary>
        public double[] Upper { get { return Numbers("upper"); } }

        /// <summary>Bodies that a frame may place.</summary>
        public string[] Bodies { get { return Texts("bodies"); } }

        /// <summary>Seconds of silence after which there is no force.</summary>
        public double Timeout { get { return Number("timeout"); } }
    }

    /// <summary>Answer to a frame.</summary>
    public sealed class State : Message
    {
        internal State(Dictionary<string, object> members) : base(members)
        {
        }

        public double Sequence { get { return Number("sequence"); } }

        /// <summary>In s, on the clock of the run: that of times in effects.</summary>
        public double Time { get { return Number("time"); } }

        /// <summary>Of the hand, in m.</summary>
        public double[] Position { get { return Numbers("position"); } }

        /// <summary>Wrenches in N and N m: what the effects desire, and what the cables do.</summary>
        public double[] Desired { get { return Numbers("desired"); } }

        public double[] Measured { get { return Numbers("measured"); } }

        /// <summary>In N, one a module.</summary>
        public double[] Tensions { get { return Numbers("tensions"); } }

        public bool[] Active { get { return Flags("active"); } }

        public double Delay { get { return Number("delay"); } }
    }

    /// <summary>Something that happened: a module that is lost, the end of the run.</summary>
    public sealed class BridgeEvent : Message
    {
        internal BridgeEvent(Dictionary<string, object> members) : base(members)
        {
        }

        public string Kind { get { return Text("kind"); } }

        public string Words { get { return Text("text"); } }

        /// <summary>Null if it is about no module.</summary>
        public string Module { get { return Text("module"); } }
    }

    /// <summary>Refusal of a frame, in place of a state.</summary>
    public sealed class Refused : Message
    {
        internal Refused(Dictionary<string, object> members) : base(members)
        {
        }

        public string Reason { get { return Text("reason"); } }
    }
}
